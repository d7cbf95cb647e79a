"""Make the pictures in docs/pages/pictures again; needs Chromium.

Most are what a command of the page that shows them writes, or `plot()` of what the function behind it returns; those of
the theory are drawn here from what the package computes.
"""

from __future__ import annotations

import asyncio
import base64
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from PIL import Image
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import gimbal_pin
from gimbal_pin.control import perturbed
from gimbal_pin.dynamics import plant_with, reduce_parameters
from gimbal_pin.effects import parse_effect
from gimbal_pin.identification import identify_new
from gimbal_pin.log import signals
from gimbal_pin.report import plots
from gimbal_pin.report.format import PALETTE, joint_colours
from gimbal_pin.report.sections.model import short
from gimbal_pin.report.view import browser
from gimbal_pin.rig import bundled_rigs, make_generator

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGES = Path(__file__).resolve().parents[1] / "docs" / "pages"
READY = "Boolean(document.querySelector('[data-figure=jitter]')) && document.querySelector('.said').textContent === ''"
"""Whether the studio has drawn all of its figures."""


def run(command: str) -> None:
    """Run a command of the package here."""
    subprocess.run(["gimbal-pin", *command.split()], check=True, stdout=subprocess.DEVNULL)


def draw_film_still(rig: str, options: str, payload: str = "") -> None:
    """Draw a rig that moves as `shown.png`."""
    run(f"simulate {rig} --seconds 12 -o log.csv {payload}")
    run(f"animate {rig} log.csv -o shown.png {options}")


def draw_thesis() -> None:
    """The rig `thesis` follows its reference."""
    draw_film_still("thesis", "--at 4.3")


def draw_drone() -> None:
    """The rig `drone` over the shoulder."""
    draw_film_still("drone", "--at 4 --camera over-the-shoulder")


def draw_bundled() -> None:
    """The five bundled rigs."""
    tiles = list[Image.Image]()
    for rig in sorted(bundled_rigs()):
        draw_film_still(rig, "--preset thumbnail --at 5")
        tiles.append(Image.open("shown.png").convert("RGB"))
    wide, high = tiles[0].size
    sheet = Image.new("RGB", (3 * wide, 2 * high), "white")
    for k, tile in enumerate(tiles):
        sheet.paste(tile, (k % 3 * wide + k // 3 * wide // 2, k // 3 * high))
    sheet.save("shown.png")


def draw_beside() -> None:
    """Two runs of one rig, their errors magnified."""
    run("simulate turret --seconds 12 -o log.csv")
    run("simulate turret --seconds 12 --controller pid -o pid.csv")
    run("animate turret log.csv --beside pid.csv --at 5 -o shown.png")


def draw_my_gimbal() -> None:
    """The gimbal of the ten steps, from the files on their page, in the motion of step 4."""
    text = (PAGES / "ten-steps.md").read_text(encoding="utf-8")
    for name, content in re.findall(r'```\w+ title="([^"]+)"\n(.*?)```', text, re.S):
        Path(name).write_text(content, encoding="utf-8")
    run("excite rig.yaml -o motion.csv --starts 1")
    run("animate rig.yaml motion.csv -o shown.png")


def draw_loops() -> None:
    """The loops that `tune` chose."""
    run("simulate turret --seconds 12 -o log.csv")
    run("tune turret log.csv --disk-margin 1.0 --plot shown.png")


def draw_pointing() -> None:
    """A camera held on a moving platform."""
    run("track turret --platform S --seeds 1 --seconds 10 --plot shown.png")


def draw_inspected() -> None:
    """A file's channels."""
    run("simulate turret --seconds 12 -o log.csv")
    run("inspect log.csv -o shown.png")


def draw_online() -> None:
    """Estimates over time."""
    run("simulate turret --seconds 15 -o log.csv")
    run("identify turret log.csv --follow --idle 1 -o model.yaml --plot shown.png")


def draw_studio() -> None:
    """The studio's page, once all of it is drawn."""
    run("simulate thesis --seconds 12 -o log.csv")

    async def shoot(url: str) -> bytes:
        async with browser.opened("") as tab:
            size = {"width": 1280, "height": 1440, "deviceScaleFactor": 1, "mobile": False}
            await tab.send_command("Emulation.setDeviceMetricsOverride", size)
            await tab.send_command("Page.navigate", {"url": url})
            while not await browser.evaluate(tab, READY):
                await asyncio.sleep(0.5)
            await asyncio.sleep(3)
            return base64.b64decode(
                (await tab.send_command("Page.captureScreenshot"))["result"]["data"]
            )

    command = ["gimbal-pin", "studio", "thesis", "log.csv", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found is not None
        Path("shown.png").write_bytes(asyncio.run(shoot(found[0])))
        process.terminate()


def draw_excitation() -> Figure:
    """A designed motion."""
    return gimbal_pin.excite(gimbal_pin.Rig.load("thesis"), starts=1, rng=0).plot()


def draw_identified() -> Figure:
    """Measured and predicted torque on data that the fit has not seen."""
    rig = gimbal_pin.Rig.load("turret")
    return gimbal_pin.identify(
        rig, [gimbal_pin.bench_run(gimbal_pin.nominal(rig), rng=0, seconds=20.0)]
    ).plot()


def draw_diagnosed() -> Figure:
    """What a model leaves before and after a cause is found."""
    rig = gimbal_pin.Rig.load("turret")
    plant = plant_with(
        gimbal_pin.nominal(rig), [parse_effect("cogging:pan:amplitude=0.03,harmonic=12", rig)]
    ).plant
    return gimbal_pin.diagnose(rig, [gimbal_pin.bench_run(plant, rng=0, seconds=25.0)]).plot()


def draw_swap() -> Figure:
    """Steps with a new camera, by controllers that were tuned with the old one and with it."""
    first, second = (
        gimbal_pin.Rig.load("turret", payload=name) for name in ("infrared", "mirrorless")
    )
    known = gimbal_pin.identify(
        first, [gimbal_pin.bench_run(gimbal_pin.nominal(first), rng=0, seconds=20.0)]
    )
    plant = perturbed(second, 0.05, make_generator(2)[0])
    swapped = identify_new(second, [gimbal_pin.bench_run(plant, rng=1, seconds=10.0)], known.model)
    models = {"tuned before the swap": known.model, "tuned after it": swapped.first.model}
    laws = {name: gimbal_pin.tune(model).controller for name, model in models.items()}
    return gimbal_pin.track(plant, laws, rng=0, one_by_one=False).plot()


def draw_rigs() -> Figure:
    """Two hundred rigs that differ."""
    spec = ["rms_error < 0.02", "peak_torque < 0.9"]
    return gimbal_pin.monte_carlo(
        gimbal_pin.Rig.load("turret"), count=200, spec=spec, seconds=1.0
    ).plot()


def draw_fleet() -> Figure:
    """A unit whose camera sits 2 mm further forward than its siblings'."""
    rig = gimbal_pin.Rig.load("turret")
    motion = gimbal_pin.excite(rig, starts=1, rng=0).motion
    plants = {f"A-{k:03d}": perturbed(rig, 0.01, make_generator(k)[0]) for k in range(10)}
    plants["A-007"] = plant_with(
        plants["A-007"], [parse_effect("payload-shift:x=0.002", rig)]
    ).plant
    Path("logs").mkdir()
    for name, plant in plants.items():
        gimbal_pin.write_log(
            gimbal_pin.bench_run(plant, rng=1, reference=motion), f"logs/{name}.csv"
        )
    return gimbal_pin.compare_fleet("logs", rig="turret", quick=True).plot()


def draw_friction() -> Figure:
    """Dry and viscous friction, and what real joints add: Stribeck's rise at low rates, a direction that costs more."""
    rig = gimbal_pin.Rig.load("turret")
    v = np.linspace(-0.6, 0.6, 1201)
    still = np.zeros((len(v), rig.n))
    causes = {
        "dry and viscous": [],
        "with Stribeck": ["stribeck:pan:speed=0.08,extra=0.03"],
        "with asymmetry": ["asymmetric-friction:pan:coulomb=0.015"],
    }

    def draw() -> Figure:
        figure, ((axes,),) = plots.panels(1, 1, 2.6)
        for each, colour in zip(causes.values(), PALETTE):
            plant = plant_with(
                gimbal_pin.nominal(rig), [parse_effect(one, rig) for one in each]
            ).plant
            rate = np.column_stack([v, *still.T[1:]])
            plots.curve(axes, v, (plant.inverse_dynamics(still, rate, still))[:, 0], color=colour)
        plots.put_legend(axes, list(zip(causes, PALETTE)))
        axes.set(xlabel="rate of pan, rad/s", ylabel="torque, N m", xlim=(v[0], v[-1]))
        return figure

    return plots.Drawing(draw, "Friction over the rate", "").draw()


def draw_base() -> Figure:
    """Which of the bodies' parameters each base parameter is a sum of."""
    rig = gimbal_pin.Rig.load("thesis")
    found = reduce_parameters(rig)
    shown = np.flatnonzero(found.mixing.any(axis=0))

    def draw() -> Figure:
        figure, ((axes,),) = plots.panels(1, 1, 5.0, left=1.3, top=1.0)
        axes.imshow(
            np.sign(found.mixing[:, shown]), cmap="PiYG", vmin=-1.6, vmax=1.6, aspect="auto"
        )
        axes.set_xticks(range(len(shown)), [found.names[k] for k in shown], rotation=90)
        axes.set_yticks(range(len(found.mixing)), [short(name) for name in found.base_names])
        axes.xaxis.tick_top()
        axes.grid(False)
        return figure

    return plots.Drawing(draw, "The bodies' parameters in each base parameter", "").draw()


def draw_moving_base() -> Figure:
    """The torque that one motion takes on a platform that stands, and on one that moves."""
    rig = gimbal_pin.Rig.load("turret")
    motion = gimbal_pin.excite(rig, starts=1, rng=0).motion
    platform = gimbal_pin.profile_s(motion.t, make_generator(0)[0])
    model = gimbal_pin.nominal(rig)
    each = (
        model.inverse_dynamics(motion.q, motion.v, motion.a, platform=one)
        for one in (None, platform)
    )
    still, moved = (signals.zero_phase(tau, signals.lowpass(12.0, 1e3)) for tau in each)

    def draw() -> Figure:
        figure, panels = plots.panels(rig.n, 1, 3.6, share=(True, False))
        for j, (joint, colour, axes) in enumerate(
            zip(rig.joints, joint_colours(rig.joints), panels[:, 0])
        ):
            plots.curve(axes, motion.t, moved[:, j], color=plots.PLAIN, lw=1.0)
            plots.curve(axes, motion.t, still[:, j], color=colour)
            plots.put_legend(
                axes,
                [(f"{joint}: the platform moves", plots.PLAIN), (f"{joint}: it stands", colour)],
            )
            axes.set_ylabel("torque, N m")
        panels[-1, 0].set(xlabel="time, s", xlim=(motion.t[0], motion.t[-1]))
        return figure

    return plots.Drawing(
        draw, "Torque of one motion on a platform that stands, and that moves", ""
    ).draw()


PICTURES: dict[str, Callable[[], Figure | None]] = {
    name.removeprefix("draw_").replace("_", "-"): make
    for name, make in dict(globals()).items()
    if name.startswith("draw_") and name != "draw_film_still"
}
"""Name of a picture → what draws it as `shown.png`, or returns it."""


def main(only: Annotated[tuple[str, ...], tyro.conf.Positional] = ()) -> None:
    """Make the pictures again.

    Args:
        only: names of some of them
    """
    home = Path.cwd()
    for name in tqdm(only or PICTURES, "pictures"):
        with TemporaryDirectory() as folder:
            os.chdir(folder)
            figure = PICTURES[name]()
            if figure is not None:
                figure.savefig("shown.png", dpi=130)
            # A tenth of PNG's size, with all colours.
            Image.open("shown.png").convert("RGB").save(
                PAGES / "pictures" / f"{name}.webp", quality=90
            )
            os.chdir(home)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
