"""Which causes make up what sets the bodies apart: composed one by one, as few as explain it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import comb, inf

from scipy.stats import chi2, f

from gimbal_pin.diagnosis.bodies import Bodies, Fitted, Kind
from gimbal_pin.effects import Cause, RigEffect
from gimbal_pin.rig import Rig

ENTER = 1e-4
"""Chance, over the whole list, from which a cause does not enter."""
BY_LUCK = 0.003
"""Chance of explaining a difference by luck from which several causes do not enter that only explain it together. That
there is a difference is as sure as for any other; this is the chance of a wrong name for it."""
MOST = 4
"""Most causes that are composed."""
UNEXPLAINED = 0.2
"""Share of the difference that may be left, or no name deserves trust."""


def kinds_of(rig: Rig, causes: Mapping[str, type[Cause]]) -> list[list[Kind]]:
    """Causes in the bodies, each in its forms: those of the given model, and what may be mistaken for them."""
    every = [kind for kind in causes.values() if issubclass(kind, RigEffect)]
    places = [(kind, joint) for kind in every for joint in (rig.joints if kind.of_joint else rig.joints[:1])]
    return [[Kind(kind, joint, tuple(held.items())) for held in kind.forms(rig)] for kind, joint in places]


def chosen(bodies: Bodies, causes: Mapping[str, type[Cause]]) -> tuple[Fitted, list[list[Kind]]]:
    """Compose causes until none is worth its parameters; return the fit, and all that could be tried.

    A mass here and a payload moved there change first moments alike: whichever enters first hides the other, so that
    each cause of the whole rig has its turn to be the first. Where one by one they explain too little, several may
    together. A cause that does not show in its plain form, products about a standing joint, is not tried in another.
    """
    told = [[kind for kind in forms if bodies.slope(kind) is not None] for forms in kinds_of(bodies.found.rig, causes)]
    tried = [forms for forms in told if forms and bodies.shows(forms[0])]
    none = bodies.nothing()
    first = entering(bodies, none, tried)
    starts = [one for one in first if one is first[0] or not one.kinds[0].of.of_joint]
    one_by_one = [one for start in starts for one in grown(bodies, start, tried)]
    best = explaining(bodies, one_by_one, tried) or explaining(bodies, together(bodies, none, tried), tried)
    return best or none, tried


def explaining(bodies: Bodies, fits: Sequence[Fitted], tried: Sequence[Sequence[Kind]]) -> Fitted | None:
    """Return the simplest of some fits; None where that leaves so much of the difference that no name is trusted."""
    best = fewest(fits, len(tried))
    if best is None:
        return None
    first, freedom = swapped(bodies, best, tried), len(bodies.found.change)
    less = simpler(bodies, first, tried)
    best = less if less is first else swapped(bodies, less, tried)
    left, whole = best.cost - freedom, bodies.nothing().cost - freedom
    return None if left > UNEXPLAINED * max(whole, 0.0) else best


def together(bodies: Bodies, none: Fitted, tried: Sequence[Sequence[Kind]]) -> list[Fitted]:
    """Fits of several causes that may not be worth their parameters one by one, where all of them together are.

    What the others leave is no noise, and a cause alone gains little of it. As many sets of them as there are count as
    tried, and what a set gains is judged by what it leaves: far less of a difference than any directions would.
    """
    if chi2.sf(none.cost, len(none.response)) > ENTER:
        return []
    sets = grown(bodies, none, tried, inf)[1:]
    return [one for one in sets if by_form(none, one) * comb(len(tried), len(one.kinds)) < BY_LUCK]


def entering(bodies: Bodies, now: Fitted, tried: Sequence[Sequence[Kind]], most: float = ENTER) -> list[Fitted]:
    """Fits with one cause more that is worth its parameters, by a chance under `most`, the best first."""
    new = [forms for forms in tried if not any(same(forms[0], kind) for kind in now.kinds)]
    others = [bodies.best(now.kinds, forms, known=now) for forms in new]
    worth = [one for one in others if one is not None and chance(now, one) * len(tried) < most]
    return sorted(worth, key=lambda one: one.worth)


def grown(bodies: Bodies, now: Fitted, tried: Sequence[Sequence[Kind]], most: float = ENTER) -> list[Fitted]:
    """Compose further causes with a fit until none is worth its parameters; every fit on the way."""
    found = [now]
    while len(found[-1].kinds) < MOST and (worth := entering(bodies, found[-1], tried, most)):
        found.append(worth[0])
    return found


def fewest(fits: Sequence[Fitted], many: int) -> Fitted | None:
    """Return the fit of as few causes as may be: more of them must leave less than by chance, of so many tried."""
    best: Fitted | None = None
    for one in sorted(fits, key=lambda one: (len(one.kinds), one.worth)):
        if best is None or (len(one.kinds) > len(best.kinds) and chance(best, one) * many < ENTER):
            best = one
    return best


def simpler(bodies: Bodies, best: Fitted, tried: Sequence[Sequence[Kind]]) -> Fitted:
    """Return the fit without one of its causes where another makes up for it, be it in a form that is implausible.

    A weight near the payload's centre is not likely; a weight elsewhere and a shift that undoes its place is less so.
    """
    for k in range(len(best.kinds) if len(best.kinds) > 1 else 0):
        rest = [*best.kinds[:k], *best.kinds[k + 1 :]]
        others = [([one for one in rest if one is not kind], forms) for kind in rest for forms in tried_as(kind, tried)]
        fits = [bodies.best(kept, forms, plausible=False, known=best) for kept, forms in others]
        less = min((fit for fit in fits if fit is not None), key=lambda fit: fit.worth, default=None)
        if less is not None and chance(less, best) * len(tried) >= ENTER:
            return less
    return best


def swapped(bodies: Bodies, best: Fitted, tried: Sequence[Sequence[Kind]]) -> Fitted:
    """The fit with each of several causes in the form that leaves least beside the others, or another in its place.

    Which one entered first was chosen where it stood for what the others do, too.
    """
    for kind in best.kinds if len(best.kinds) > 1 else ():
        rest = [other for other in best.kinds if other != kind]
        free = [forms for forms in tried if not any(same(forms[0], other) for other in rest)]
        fits = [bodies.best(rest, forms, known=best) for forms in free]
        best = min([best, *(fit for fit in fits if fit is not None)], key=lambda fit: fit.worth)
    return best


def tried_as(kind: Kind, tried: Sequence[Sequence[Kind]]) -> list[Sequence[Kind]]:
    """The forms in which a kind's cause was tried."""
    return [forms for forms in tried if same(forms[0], kind)]


def same(a: Kind, b: Kind) -> bool:
    """Whether two are forms of one cause at one place."""
    return (a.of, a.joint) == (b.of, b.joint)


def chance(less: Fitted, more: Fitted) -> float:
    """Chance of the gain from one fit to a larger one if there is nothing, in units of what the larger one leaves."""
    freedom = max(more.freedom - less.freedom, 1)
    return float(chi2.sf((less.cost - more.cost) / more.excess, freedom))


def by_form(less: Fitted, more: Fitted) -> float:
    """Chance of the gain from one fit to a larger one if what the smaller one leaves is an error of its form.

    Such an error points anywhere: of what it leaves, one cause more takes up a share as a random direction has it (F,
    by what the larger fit leaves). One where that leaves no direction to judge by.
    """
    freedom, spare = max(more.freedom - less.freedom, 1), len(more.response) - more.freedom
    return float(f.sf((less.cost - more.cost) / more.excess / freedom, freedom, spare)) if spare > 0 else 1.0
