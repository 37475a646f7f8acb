"""Pictures look as they did: compared with those in tests/baseline, which people have looked at.

Text is left out, since its rendering differs between versions of matplotlib; what it says is
tested elsewhere.  After a wanted change, ``python tests/test_plotting_images.py`` draws the
pictures anew; look at them before they are committed.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.testing.compare import compare_images
from matplotlib.text import Text

from fuzzykf import CGOFMSModel, FilterResult, FuzzyMarkovLaw, FuzzyRelationEstimator
from fuzzykf.plotting import BLUE, ORANGE, TRUTH
from fuzzykf.plotting.style import STRIP, SURFACE

BASELINE = Path(__file__).parent / "baseline"

#: Root mean square difference of pixels, of 255.  Other versions of matplotlib differ by less;
#: the changes below by more.
TOLERANCE = 3.0


def blank(**options):
    """Axes at a fixed place of a small figure, so that no layout depends on text."""
    figure = Figure(figsize=(4.0, 2.5), dpi=80)
    return figure.add_axes((0.06, 0.08, 0.86, 0.86), **options)


def make_model():
    z = np.array([[1.0, 0.5], [0.5, 0.4]])
    pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel(law, [[0.0, 3.0], [2.0, 0.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1)


def draw_result(level=0.9, switch=0.2):
    n = np.arange(60.0)
    result = FilterResult(
        x=np.sin(n / 6)[:, None],
        P=(0.1 + 0.05 * np.cos(n / 10) ** 2)[:, None, None],
        switch_mean=np.clip(n * switch / 10, 0.0, 1.0),
        nodes=np.array([0.0, 0.5, 1.0]),
    )
    return result.plot(blank(), level=level, truth=np.sin(n / 6) + 0.2 * np.cos(n))


def draw_law(delta=0.20):
    return FuzzyMarkovLaw.fmc2(0.15, 0.12 / delta, delta).plot(blank(projection="3d"))


def draw_model(component=0):
    return make_model().plot(blank(), component=component)


def draw_hard_model():
    return make_model().harden().plot(blank())


def draw_estimate(correlation=0.8):
    est = FuzzyRelationEstimator(2, 1)
    est.x, est.P = np.array([[1.0], [2.0]]), np.array([[1.0, correlation], [correlation, 1.0]])
    return est.plot(blank(), truth=[1.5, 2.0])


PICTURES = {
    "result": draw_result,
    "law": draw_law,
    "model": draw_model,
    "hard_model": draw_hard_model,
    "estimate": draw_estimate,
}

#: Changes that a reader would see, and that have to be found.
CHANGES = {
    "result with another band": ("result", lambda: draw_result(level=0.5)),
    "result with another switch": ("result", lambda: draw_result(switch=0.4)),
    "law with a narrower density": ("law", lambda: draw_law(delta=0.17)),
    "model without its bands": ("model", lambda: without_bands(draw_model())),
    "estimate with another slope": ("estimate", lambda: draw_estimate(correlation=0.5)),
    "model in grey": ("model", lambda: in_grey(draw_model())),
    "hard model for a fuzzy one": ("model", draw_hard_model),
}


def without_bands(axes):
    for band in list(axes.collections):
        band.remove()
    return axes


def in_grey(axes):
    for line in axes.get_lines():
        line.set_color("0.5")
    for band in axes.collections:
        band.set_facecolor("0.8")
    return axes


def save(axes, path):
    figure = axes.figure
    for part in figure.findobj(lambda artist: isinstance(artist, (Legend, Text))):
        part.set_visible(False)
    figure.savefig(path, metadata={"Software": None})


def render(draw, path):
    with mpl.rc_context(mpl.rcParamsDefault):
        save(draw(), path)


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_looks_as_it_did(name, tmp_path) -> None:
    render(PICTURES[name], tmp_path / f"{name}.png")
    difference = compare_images(str(BASELINE / f"{name}.png"), str(tmp_path / f"{name}.png"), TOLERANCE)
    assert difference is None, difference


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_that_can_be_seen_is_found(change, tmp_path) -> None:
    name, draw = CHANGES[change]
    render(draw, tmp_path / "changed.png")
    found = compare_images(str(BASELINE / f"{name}.png"), str(tmp_path / "changed.png"), TOLERANCE)
    assert found is not None


# --------------------------------------------------------------------------- colours


def lightness(rgb):
    """CIE L* of sRGB colours, 0 to 100: what is left in a grey print."""
    rgb = np.asarray(rgb, dtype=np.float64)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return np.where(luminance > 0.008856, 116 * np.cbrt(luminance) - 16, 903.3 * luminance)


@pytest.mark.parametrize("name", [STRIP, SURFACE])
def test_colour_maps_are_ordered_in_grey(name) -> None:
    steps = np.diff(lightness(mpl.colormaps[name](np.linspace(0, 1, 64))[:, :3]))
    assert (steps > 0).all() or (steps < 0).all()


# H. Brettel and others, in the linear form of Viénot, Brettel and Mollon (1999): how sRGB
# looks without the long, or without the medium cones.
PROTAN = [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]
DEUTAN = [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]


@pytest.mark.parametrize("seen", [np.eye(3), PROTAN, DEUTAN], ids=["all cones", "protan", "deutan"])
def test_colours_stay_apart_for_colour_blind_readers(seen) -> None:
    colours = [
        np.asarray(seen) @ np.square(mpl.colors.to_rgb(c)) for c in (BLUE, ORANGE, TRUTH)
    ]  # squares: about linear
    for k, one in enumerate(colours):
        for other in colours[k + 1 :]:
            assert np.abs(np.sqrt(np.clip(one, 0, 1)) - np.sqrt(np.clip(other, 0, 1))).max() > 0.3


if __name__ == "__main__":
    BASELINE.mkdir(exist_ok=True)
    for name, draw in PICTURES.items():
        render(draw, BASELINE / f"{name}.png")
