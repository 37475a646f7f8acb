"""The pictures of laws on graphs, and of paths of the switch, show the numbers they should."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch

from fuzzykf import FadeLaw, GraphLaw
from fuzzykf.errors import ShapeError
from fuzzykf.plotting import BLUE, ORANGE, plot_graph, plot_path

RING = FadeLaw(3, {(0, 1): (0.05, 10), (1, 2): (0.1, 8), (2, 0): (0.025, 6)}, jumps={(0, 2): 0.002})


@pytest.fixture(autouse=True)
def without_screen():
    mpl.use("Agg")
    yield
    from matplotlib import pyplot

    pyplot.close("all")


def arrows(axes):
    return [patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]


def test_a_fade_law_is_drawn_with_its_rates_and_jumps() -> None:
    axes = RING.plot()
    texts = [text.get_text() for text in axes.texts]
    assert texts == ["0.05, 10 steps", "0.1, 8 steps", "0.025, 6 steps", "0.002", "0", "1", "2"]
    colours = [mpl.colors.to_hex(arrow.get_edgecolor()).upper() for arrow in arrows(axes)]
    assert colours == [BLUE] * 3 + [ORANGE]
    assert [arrow.get_linestyle() for arrow in arrows(axes)] == ["-"] * 3 + ["--"]
    # class 0 on top, the others clockwise
    corners = np.array([circle.get_offsets()[0] for circle in axes.collections])
    np.testing.assert_allclose(corners, [[0, 1], [3**0.5 / 2, -0.5], [-(3**0.5) / 2, -0.5]], atol=1e-12)


def test_a_graph_law_is_drawn_with_its_masses() -> None:
    law = GraphLaw.from_masses([3, 3, 2], {(0, 1): 1.5, (2, 1): 0.5}, jumps={(0, 1): 0.2, (0, 2): 0.1})
    axes = law.plot()
    texts = [text.get_text() for text in axes.texts]
    assert texts == ["0.15", "0.05", "0.04", "0.02", "0", "1", "2"]  # edges, then jumps both ways
    heads = [arrow.get_arrowstyle() for arrow in arrows(axes)]
    assert not any(head.arrow.endswith(">") for head in heads)
    # an edge is straight, and a jump between the same classes beside it
    edge, _, jump, _ = (arrow.get_path().vertices for arrow in arrows(axes))
    bends = [np.abs(one[1] - one[[0, -1]].mean(axis=0)).max() for one in (edge, jump)]
    assert bends[0] < 1e-6
    assert bends[1] > 0.02


def test_each_way_between_two_classes_is_an_arrow_of_its_own() -> None:
    axes = plot_graph(FadeLaw.between(40, 10, jump=0.005))
    middles = [
        arrow.get_path().get_extents().y0 + arrow.get_path().get_extents().y1 for arrow in arrows(axes)
    ]
    assert len({round(middle, 6) for middle in middles}) == 4
    labels = [text.get_position() for text in axes.texts][:4]
    assert len({tuple(np.round(position, 6)) for position in labels}) == 4


def test_a_path_is_drawn_as_it_was_sampled() -> None:
    law = FadeLaw.between(12, 4)
    r = law.sample(50, np.random.default_rng(2))
    for axes in (plot_path(r), law.plot(rng=np.random.default_rng(2), n=50)):
        np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), r)
    weights = RING.sample(50, np.random.default_rng(2))
    axes = RING.plot(rng=np.random.default_rng(2), n=50)
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["class 0", "class 1", "class 2"]
    first = axes.collections[0].get_paths()[0].vertices
    np.testing.assert_allclose(sorted(set(first[:, 1])), sorted({0.0, *weights[:, 0]}), atol=1e-12)
    for wrong in (np.zeros((2, 2, 2)), [], 3.0):
        with pytest.raises(ShapeError, match="r: got shape"):
            plot_path(wrong)
