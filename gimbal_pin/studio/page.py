"""The page: elements that show a state, and events that move it; all else stands in the other files."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

from markupsafe import Markup
from nicegui import background_tasks, run, ui

from gimbal_pin.control.laws.design import Wish
from gimbal_pin.control.laws.reasons import ReasonKind
from gimbal_pin.control.tuning import Tuning
from gimbal_pin.effects.rig_effect import get_payload
from gimbal_pin.errors import GimbalPinError, UsageError
from gimbal_pin.studio import options
from gimbal_pin.studio.desk import Desk
from gimbal_pin.studio.figures import ResidualFigure, simulate_pointing
from gimbal_pin.studio.saving import Writer, keep_controller, keep_report, list_studio_files
from gimbal_pin.studio.state import History, StudioState, list_sliders
from gimbal_pin.studio.subject import StudioSource, Subject, list_causes


class Handle(NamedTuple):
    """Ends and step of a slider, in what its choice is shown in; a number that is typed may lie beyond them."""

    low: float
    high: float
    step: float


def weigh_payload(subject: Subject) -> float:
    """Return what the payload weighs as stated, kg; zero where there is none."""
    try:
        return float(get_payload(subject.rig)[1].mass)
    except UsageError:
        return 0.0


def build_handles(subject: Subject) -> dict[str, Handle]:
    """Return the handles of what can be moved: without a payload its place and mass cannot."""
    ms = 1e3 * Wish.of(subject.model).dt
    loops = {
        "bandwidth_hz": Handle(0.5, 50, 0.1),
        "disk_margin": Handle(0.05, 1.5, 0.01),
        "delay": Handle(0, min(20 * ms, 50), ms / 10),
    }
    if not (mass := weigh_payload(subject)):
        return loops
    heavy = Handle(0.1 * mass, 3 * mass, float(f"{mass / 100:.1g}"))
    return {**loops, **dict.fromkeys("xyz", Handle(-50, 50, 0.5)), "mass": heavy}


def describe_other_camera(source: StudioSource, state: StudioState) -> str:
    """Return a sentence where the logs were recorded with another camera than the one that is mounted, else nothing."""
    if state.payload is None or not source.logs:
        return ""
    recorded = source.rig.payload or "the rig's own camera"
    return f"The log was recorded with {recorded}, not with {state.payload}: its residual includes the swap."


async def open_window(desk: Desk, seconds: float = 1.0) -> None:
    """Build a window, and draw it before it is served; figures that take more than some seconds come later."""
    drawing = background_tasks.create(Window(desk).redraw())
    await asyncio.wait([drawing], timeout=seconds)


class Window:
    """One window: what it shows, and what happens when something in it is moved."""

    def __init__(self, desk: Desk) -> None:
        """Build the elements, without values."""
        self.desk = desk
        self.wanted = desk.history.present
        self.subject = desk.find_subject(StudioState())
        self.tuning: Tuning | None = None
        self.drawn: StudioState | None = None
        self.residual: ResidualFigure | None = None
        self.marked: tuple[float, float] | None = None
        self.is_drawing = self.is_setting = False
        self.handles = build_handles(self.subject)
        self.choices = list_sliders()
        self.sliders: dict[str, Any] = {}
        self.numbers: dict[str, Any] = {}
        self.labels: dict[str, Any] = {}
        self.notes: dict[str, Any] = {}
        self.charts: dict[str, Any] = {}
        ui.add_css(files("gimbal_pin.studio").joinpath("page.css").read_text(encoding="utf-8"))
        ui.add_head_html('<meta name="referrer" content="no-referrer">')
        with ui.element("div").classes("studio"):
            self.build_head()
            with ui.element("div").classes("controls"):
                self.build_controls()
            with ui.element("div").classes("panels"):
                self.build_panels()
        ui.keyboard(self.press_key)

    # -- elements ------------------------------------------------------------------------------------------------------

    def build_head(self) -> None:
        """Build title, buttons and the line that says what happened."""
        with ui.element("header"):
            self.title = ui.html("", tag="h1", sanitize=False)
            self.build_cameras()
            self.back = self.build_button("Undo", self.undo)
            self.forth = self.build_button("Redo", self.redo)
            controller, report = list_studio_files()
            self.build_button("Save controller", partial(self.save, controller, keep_controller))
            self.build_button(
                "Save report",
                partial(self.save, report, lambda tuning, folder: keep_report(tuning)),
            )
        self.said = ui.label("").classes("said").props('role="status"')

    def build_button(self, title: str, act: Callable[[], object]) -> Any:
        """Return a button of the head."""
        look = (
            f"outline dense no-caps padding='4px 10px' data-act={title.lower().replace(' ', '-')}"
        )
        return ui.button(title, on_click=act).props(look)

    def build_cameras(self) -> None:
        """Build the button that swaps the camera, and the list that it opens."""
        with (
            ui.dialog().props('aria-label="Mount another camera"') as self.cameras,
            ui.element("div").classes("cameras"),
        ):
            ui.html("Mount another camera", tag="strong", sanitize=False)
            self.camera_list = ui.element("div").classes("cameras-list")
            path = ui.input("or the path of its URDF").props("dense outlined")
            ui.button("Mount", on_click=lambda: self.swap(path.value.strip() or None)).props(
                "no-caps"
            )
        self.build_button("Swap camera", self.show_cameras)

    def build_controls(self) -> None:
        """Build a slider with its number for each choice, and a box for each cause."""
        groups = {
            "Controller": ("bandwidth_hz", "disk_margin", "delay"),
            "Payload": ("x", "y", "z", "mass"),
        }
        for title, names in groups.items():
            with ui.element("section").classes("card"):
                ui.html(title, tag="h2", sanitize=False)
                for name in [name for name in names if name in self.handles]:
                    self.build_choice(name)
                if not any(name in self.handles for name in names):
                    ui.label(
                        "The rig carries no payload of its own: swap the camera to mount one."
                    ).classes("side")
        with ui.element("section").classes("card"):
            ui.html("Causes that the controller knows", tag="h2", sanitize=False)
            self.causes = ui.element("div").classes("causes")
            self.boxes: dict[str, Any] = {}

    def build_choice(self, name: str) -> None:
        """Build one slider, its number, and the button that gives the choice back."""
        handle = self.handles[name]
        choice = self.choices[name]
        with ui.element("div").classes("choice"):
            self.labels[name] = ui.label(", ".join(filter(None, (choice.label, choice.unit))))
            number = ui.number(format="%.4g")
            number.props(f'dense borderless aria-label="{choice.label}" data-number="{name}"')
            ui.button(icon="restart_alt", on_click=partial(self.move, name, None)).props(
                f'flat dense round size=sm aria-label="{choice.label}: as proposed" title="as proposed"'
            )
            slider = ui.slider(min=handle.low, max=handle.high, step=handle.step)
            slider.props(f'dense aria-label="{choice.label}" data-slider="{name}"')
            self.notes[name] = (
                ui.label("").classes("note").props(f'role="alert" data-note="{name}"')
            )
        self.sliders[name], self.numbers[name] = slider, number
        slider.on_value_change(lambda event: self.slide(name, event.value))
        slider.on("change", lambda event: self.move(name, round(event.args, 6) / choice.factor))
        for event in ("blur", "keydown.enter"):
            number.on(event, lambda: self.enter_number(name))

    def build_panels(self) -> None:
        """Build the scene, which stands until it is played, the numbers and the charts."""
        logs = self.desk.source.logs
        with self.build_card("Scene"):
            self.scene = ui.element("iframe").props('title="The rig"')
            self.scene.on("load", js_handler="event => event.target.contentWindow.seek?.(0)")
        with self.build_card("Figures"):
            self.table = ui.html("", sanitize=False)
            self.other_camera = ui.label("").classes("side").props("data-figure=other-camera")
            self.jitter = ui.html("", sanitize=False)
            self.reasons = ui.html("", sanitize=False).classes("side")
        if logs:
            with self.build_card("Log: drag to mark what judges") as self.log_card:
                self.charts["log"] = ui.echart({}).classes("chart")
                self.charts["log"].on("chart:brushEnd", self.brush, ["areas"])
                with ui.element("div").classes("judged"):
                    self.judged = ui.label("").classes("side")
                    ui.button("As proposed", on_click=partial(self.move, "judged", None)).props(
                        "flat dense no-caps"
                    )
            with self.build_card("Residual of the judged part"):
                self.charts["residual"] = ui.echart({}).classes("chart")
        for name, title in (
            ("nyquist", "Nyquist"),
            ("step", "After a step of 1 rad/s² of disturbance"),
        ):
            with self.build_card(title):
                self.charts[name] = ui.echart({}).classes(f"chart {name}")
        with self.build_card("Line of sight on a platform that is shaken").classes("wide"):
            if self.subject.unable:
                ui.label(f"This rig cannot hold its camera: {self.subject.unable}.").classes("side")
            else:
                self.charts["pointing"] = ui.echart({}).classes("chart")
                ui.label(
                    "Half a second of profile S; 'gimbal-pin track' measures 30 s and against a PID."
                ).classes("side")

    def build_card(self, title: str) -> Any:
        """Return an open card with a title."""
        card = ui.element("section").classes("card")
        with card:
            ui.html(title, tag="h2", sanitize=False)
        return card

    # -- what happens --------------------------------------------------------------------------------------------------

    async def slide(self, name: str, position: float) -> None:
        """Show a value while its slider is dragged; it is chosen when it is let go."""
        if not self.is_setting and position is not None:
            shown = round(position, 6)
            self.set_value(self.numbers[name], shown)
            await self.show(
                self.desk.history.present.moved(name, shown / self.choices[name].factor)
            )

    async def enter_number(self, name: str) -> None:
        """Choose the number that was typed; without one the field says again what is chosen."""
        value = self.numbers[name].value
        if value is None:
            self.set_values()
        elif not self.is_setting and value != self.read_shown(name):
            await self.move(name, value / self.choices[name].factor)

    async def move(self, name: str, value: Any) -> None:
        """Choose a value, or say beside its field why it cannot be."""
        try:
            history = self.desk.history.moved(name, value)
        except GimbalPinError as error:
            self.set_values({name: str(error)})
            return
        await self.change(history)

    async def undo(self) -> None:
        """Go back to what was chosen before."""
        await self.change(self.desk.history.undone())

    async def redo(self) -> None:
        """Choose again what was undone."""
        await self.change(self.desk.history.redone())

    async def press_key(self, event: Any) -> None:
        """Undo with Ctrl-Z, redo with Ctrl-Y."""
        if event.action.keydown and event.modifiers.ctrl and event.key in ("z", "y"):
            await (self.undo() if event.key == "z" else self.redo())

    async def brush(self, event: Any) -> None:
        """Let the marked part of the log judge, and the rest train."""
        areas = event.args["areas"]
        self.charts["log"].run_chart_method("dispatchAction", {"type": "brush", "areas": []})
        if areas:
            first, last = areas[0]["coordRange"]
            await self.move("judged", (max(first, 0.0), max(last, 0.0)))

    def show_cameras(self) -> None:
        """Open the list of cameras."""
        self.camera_list.clear()
        with self.camera_list:
            for name in self.desk.list_cameras():
                ui.button(name, on_click=partial(self.swap, name)).props(
                    "flat no-caps align=left"
                ).classes("camera")
        self.cameras.open()

    async def swap(self, payload: str | None) -> None:
        """Mount another camera."""
        self.cameras.close()
        if payload is not None:
            is_own = payload == self.desk.source.rig.payload
            await self.move("payload", None if is_own else payload)

    async def save(self, name: str, keep: Callable[[Tuning, Path], Writer]) -> None:
        """Write a file of what is chosen, once that is tuned, and say where it lies."""
        self.say(f"writing {name} …")
        while self.is_drawing:
            await asyncio.sleep(0.05)
        tuning = self.tuning
        desk = self.desk
        if tuning is None:
            self.say(
                "what is chosen has no controller: choose something else, or undo", is_bad=True
            )
            return
        try:
            path = await run.io_bound(lambda: desk.save_file(name, keep(tuning, desk.folder)))
            self.say(f"saved {path}")
        except GimbalPinError as error:
            self.say(str(error), is_bad=True)

    async def change(self, history: History) -> None:
        """Take other choices, and show them."""
        self.desk.history = history
        self.set_buttons()
        await self.show(history.present)

    async def show(self, state: StudioState) -> None:
        """Show a state as soon as the one before is drawn; of several that wait the last."""
        self.wanted = state
        await self.redraw()

    async def redraw(self) -> None:
        """Draw the wanted state; one that cannot be leaves the history, and the one before it is chosen again."""
        if self.is_drawing:
            return
        self.is_drawing = True
        refused = {}
        try:
            while self.drawn != self.wanted:
                state = self.wanted
                try:
                    await self.draw(state)
                except GimbalPinError as error:
                    refused = self.refuse(state, str(error))
                    if self.wanted == state:
                        break
            self.set_values(refused)
        finally:
            self.is_drawing = False

    def refuse(self, state: StudioState, why: str) -> dict[str, str]:
        """Go back from a state that cannot be; return why beside each number that it asked for, or say it."""
        self.desk.history = self.desk.history.refused(state)
        if self.wanted == state:
            self.wanted = self.desk.history.present
        asked = [
            name for name in self.numbers if getattr(state, name) != getattr(self.wanted, name)
        ]
        self.say("" if asked else why, is_bad=True)
        self.list_boxes(self.wanted)
        return dict.fromkeys(asked, why)

    async def draw(self, state: StudioState) -> None:
        """Draw one state: first the loops, then what a simulation of the held camera gives.

        Raises:
            GimbalPinError: It cannot be; what was shown before still is.
        """
        if (state.payload, state.judged) not in self.desk.subjects:
            self.say("preparing …")
        found = await run.io_bound(self.desk.tune_loops, state)
        self.drawn = state
        if found is None:  # the server ends
            return
        self.subject, self.tuning, residual = found
        self.fit_handles()
        self.draw_loops(state, self.tuning, residual)
        if self.wanted != state:  # the slider has gone on: the loops follow it, the camera waits
            self.drawn = None
            return
        try:
            pointing = await run.io_bound(simulate_pointing, self.subject, state, self.tuning)
            shown = {"series": []} if pointing is None else options.build_pointing_options(pointing)
            said = "" if pointing is None else options.describe_jitter(pointing)
        except GimbalPinError as error:
            shown = {"series": []}
            said = str(error)
        self.put("pointing", shown)
        self.jitter.set_content(
            Markup('<p>jitter <b data-figure="jitter">{}</b></p>').format(said) if said else ""
        )
        self.say("")

    # -- what is shown -------------------------------------------------------------------------------------------------

    def draw_loops(
        self, state: StudioState, tuning: Tuning, residual: ResidualFigure | None
    ) -> None:
        """Show the loops, the residual, and what is chosen."""
        rig = self.subject.rig
        source = self.desk.source
        self.title.set_content(Markup("{}").format(rig.title))
        self.put("nyquist", options.build_nyquist_options(tuning))
        self.put("step", options.build_step_options(tuning))
        if residual is not None:
            if residual is not self.residual:
                self.put("residual", options.build_residual_options(residual, rig))
            self.residual = residual
            is_new = "series" not in self.charts["log"].options
            marked = options.find_judged(source, state)
            if is_new or marked != self.marked:
                self.put("log", options.build_log_options(source.logs, rig, marked))
                self.marked = marked
            if is_new:
                pen = {"type": "takeGlobalCursor", "key": "brush"}
                pen["brushOption"] = {"brushType": "lineX", "brushMode": "single"}  # type: ignore[assignment]
                with self.log_card:
                    ui.timer(
                        0.3,
                        lambda: self.charts["log"].run_chart_method("dispatchAction", pen),
                        once=True,
                    )
            self.judged.set_text(options.describe_judged(source, state))
        self.table.set_content(options.build_table(tuning, residual).__html__())
        self.other_camera.set_text(describe_other_camera(source, state))
        reasons = [
            one for one in tuning.reasons if one.kind is not ReasonKind.LOWERED
        ]  # those stand beside the field
        said = [*tuning.warnings, *tuning.doubts, *map(str, reasons)]
        self.reasons.set_content(
            Markup("").join(Markup("<p>{}</p>").format(one) for one in said[:4])
        )
        self.scene.props(
            f'src="scene?{urlencode({"payload": state.payload} if state.payload else {})}"'
        )
        if self.wanted == state:
            self.list_boxes(state)
            self.set_values()

    def put(self, name: str, shown: options.Options) -> None:
        """Show a chart's figures; after the first ECharts takes them directly: Vue would watch and draw every point."""
        if name not in self.charts:
            return
        chart = self.charts[name]
        before = chart.options.get("series")
        chart.options.clear()
        chart.options.update(shown)
        if before is None:
            chart.update()
        else:
            is_other = len(before) != len(shown["series"])
            chart.run_chart_method("setOption", shown, {"notMerge": is_other})

    def list_boxes(self, state: StudioState) -> None:
        """Show a box for each cause of the model."""
        causes = list_causes(self.subject.model)
        if tuple(self.boxes) != causes:
            self.causes.clear()
            with self.causes:
                self.boxes = {
                    name: ui.checkbox(name, value=True, on_change=self.tick).props("dense")
                    for name in causes
                }
                if all(name.split()[0] in ("coulomb", "viscous") for name in causes):
                    ui.label(
                        "Further causes are diagnose's to find: give its extended.yaml as --model."
                    ).classes("side")
        for name, box in self.boxes.items():
            self.set_value(box, name not in state.off)

    async def tick(self) -> None:
        """Let the controller know the causes whose boxes are ticked."""
        if not self.is_setting:
            await self.move("off", tuple(name for name, box in self.boxes.items() if not box.value))

    def fit_handles(self) -> None:
        """Give the sliders the ends of the camera that is mounted."""
        for name, handle in build_handles(self.subject).items():
            if name in self.sliders and handle != self.handles[name]:
                self.handles[name] = handle
                self.sliders[name].props(f"min={handle.low} max={handle.high} step={handle.step}")

    def read_shown(self, name: str) -> float | None:
        """Return the value that holds, which may be less than was chosen; None: nothing is drawn yet."""
        value = getattr(self.wanted, name)
        if self.tuning is not None and name not in ("x", "y", "z", "mass"):
            wish = self.tuning.wish
            hertz = max(self.tuning.bandwidth_hz)
            value = {"bandwidth_hz": hertz, "disk_margin": wish.disk, "delay": wish.delay}[name]
        elif name == "mass" and value is None:
            value = weigh_payload(self.subject)
        return None if value is None else float(f"{self.choices[name].factor * value:.4g}")

    def set_values(self, refused: Mapping[str, str] | None = None) -> None:
        """Let sliders and numbers say what holds, and beside a number why it was refused, or is less than chosen."""
        for name, handle in self.handles.items():
            shown = self.read_shown(name)
            self.set_value(self.numbers[name], shown)
            self.set_value(
                self.sliders[name],
                None if shown is None else min(max(shown, handle.low), handle.high),
            )
        notes = dict(refused or {})
        if self.tuning is not None:
            late = self.tuning.wish.delay / self.tuning.wish.dt
            self.labels["delay"].set_text(f"delay, ms ({late:.3g} sample{'s' * (late != 1)})")
            lowered = [str(one) for one in self.tuning.reasons if one.kind is ReasonKind.LOWERED]
            notes.setdefault("bandwidth_hz", "; ".join(lowered))
        for name, note in self.notes.items():
            note.set_text(notes.get(name, ""))
        self.set_buttons()

    def set_buttons(self) -> None:
        """Let undo and redo be pressed where there is something to go to."""
        self.back.set_enabled(bool(self.desk.history.past))
        self.forth.set_enabled(bool(self.desk.history.future))

    def set_value(self, element: Any, value: Any) -> None:
        """Let an element say something that nobody chose in it."""
        self.is_setting = True
        try:
            element.set_value(value)
        finally:
            self.is_setting = False

    def say(self, text: str, is_bad: bool = False) -> None:
        """Say what happened, in one line."""
        self.said.set_text(text)
        self.said.classes(add="bad" if is_bad else "", remove="" if is_bad else "bad")
