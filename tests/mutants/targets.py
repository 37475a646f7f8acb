"""Which equations are made wrong, how many times, and which tests ought to notice."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["TARGETS", "Target"]


@dataclass(frozen=True)
class Target:
    """A source file.

    Attributes
    ----------
    file : str
        Path below ``fuzzykf``.
    number : int
        How many mutants are drawn.
    tests : tuple of str
        Paths below ``tests``, those that notice most first.
    functions : str
        Regular expression for the names of the functions that are changed; empty for all.
    unit : str
        The .pyx that is compiled anew; empty for Python.
    """

    file: str
    number: int
    tests: tuple[str, ...]
    functions: str = ""
    unit: str = ""

    @property
    def engine(self) -> str:
        """Which engine the tests use."""
        return "compiled" if self.unit else "numpy"


RECURSION = (
    "engine/numpy/test_series.py",
    "engine/numpy/test_gaps.py",
    "switching/filters/test_fields.py",
    "exactness/test_switching_enumeration.py",
    "switching/inference/test_exact.py",
    "switching/inference/test_mixture.py",
    "switching/inference/test_method.py",
    "exactness/test_outliers.py",
    "exactness/test_switching_reference.py",
    "switching/filters/test_switching_filter.py",
    "switching/filters/test_known_switch.py",
)
GAPS = (
    "engine/numpy/test_gaps.py",
    "exactness/test_gaps.py",
    "exactness/test_gaps_after_outliers.py",
    "switching/inference/test_mixture.py",
    "switching/filters/test_fields.py",
)
HIDDEN_MARKOV = ("engine/numpy/test_hidden_markov.py", "switching/learning/test_em.py")
BACKWARD = (
    "exactness/test_outliers.py",
    "switching/inference/test_most_likely_path.py",
    "exactness/test_smoother.py",
    "exactness/test_gaps.py",
    "switching/inference/test_smoother.py",
    "switching/inference/test_forecast.py",
)
LAWS = (
    "switching/laws/test_chain.py",
    "switching/laws/test_cells.py",
    "switching/laws/test_quadrature.py",
    "switching/laws/test_integration.py",
    "switching/laws/test_law.py",
    "switching/laws/test_registry.py",
    "switching/learning/test_chains.py",
)
FORMS = (
    "switching/dynamics/test_forms.py",
    "switching/dynamics/test_interpolation.py",
    "exactness/test_switching_enumeration.py",
    "switching/models",
)
STATE_SPACE = (
    "switching/state_space/test_conversion.py",
    "exactness/cmshlm",
    "switching/state_space/test_cglssm.py",
    "switching/state_space/test_converted.py",
    "switching/state_space/test_closeness.py",
)
ON_NODES = (
    "engine/numpy/test_nodes.py",
    "exactness/test_state_space.py",
    "switching/filters/test_switching_kalman.py",
    "switching/filters/test_known_switch.py",
    "switching/state_space/test_model.py",
)
PAIRWISE = (
    "switching/dynamics/test_exactness.py",
    "switching/dynamics/test_joint.py",
    "switching/inference/test_joint.py",
    "exactness/test_pairwise.py",
    "switching/models/test_pairwise.py",
    "switching/filters/test_pairwise_kalman.py",
)
TO_EXACT = ("exactness/test_to_exact.py", "switching/state_space/test_to_exact.py")
CLOSED = ("possibility/test_closed_form.py", "possibility/test_norms.py", "possibility/memberships")
KALMAN = (
    "kalman/test_fields.py",
    "kalman/test_kalman_filter.py",
    "kalman/test_functions.py",
    "kalman/test_linear_series.py",
    "kalman/test_smoothing.py",
    "kalman/test_variants.py",
    "kalman/test_extended.py",
    "kalman/test_stepper.py",
    "kalman/test_jacobian.py",
    "properties/test_kalman_filterpy.py",
)
IMM = (
    "engine/numpy/test_imm.py",
    "kalman/test_fields.py",
    "kalman/test_imm.py",
    "kalman/test_bank_stepper.py",
    "kalman/test_variants.py",
)
LEARNING = (
    "switching/learning/test_likelihood.py",
    "switching/learning/test_chains.py",
    "switching/learning/test_em.py",
    "switching/learning/test_gaussians.py",
    "switching/learning/test_data.py",
    "switching/learning/test_learning.py",
    "switching/learning/test_warnings.py",
    "properties/test_learning.py",
)
C_RECURSION = (
    "engine/compiled/test_switching.py",
    "engine/compiled/test_hidden_markov.py",
    "engine/compiled/test_series.py",
    "engine/compiled/test_backward.py",
    "switching/filters/test_fields.py",
    "switching/inference/test_exact.py",
    "exactness/test_switching_enumeration.py",
    "exactness/test_outliers.py",
)
C_KALMAN = (
    "kalman/test_fields.py",
    "engine/compiled/test_kalman.py",
    "engine/compiled/test_imm.py",
    "kalman/test_fields.py",
    "kalman/test_linear_series.py",
    "kalman/test_imm.py",
)

ENGINE, INFERENCE, LAW = "engine/numpy/", "switching/inference/", "switching/laws/"
SPACE, LEARN, SOURCE, CORE = (
    "switching/state_space/",
    "switching/learning/",
    "engine/compiled/src/",
    "engine/compiled/",
)

TARGETS = (
    Target(ENGINE + "switching.py", 10, RECURSION + BACKWARD),
    Target(ENGINE + "gaps.py", 8, GAPS),
    Target(
        "gaussian.py", 4, ("test_gaussian.py", *GAPS), "lower_factor|solve_lower|mixture_root|covariance_root"
    ),
    Target(ENGINE + "outliers.py", 4, ("exactness/test_outliers.py",)),
    Target(
        ENGINE + "hidden_markov.py",
        6,
        ("engine/numpy/test_hidden_markov.py", "switching/learning/test_em.py"),
    ),
    Target(ENGINE + "series.py", 10, RECURSION),
    Target(ENGINE + "backward.py", 4, BACKWARD),
    Target(INFERENCE + "exact.py", 8, RECURSION + BACKWARD),
    Target(INFERENCE + "mixture.py", 4, RECURSION + BACKWARD),
    Target(INFERENCE + "series.py", 5, RECURSION + BACKWARD),
    Target(ENGINE + "gap_backward.py", 8, (*BACKWARD, "exactness/test_gaps_after_outliers.py")),
    Target(INFERENCE + "smoother.py", 5, BACKWARD),
    Target(INFERENCE + "forecast.py", 3, ("switching/filters/test_fields.py", *BACKWARD)),
    Target("switching/dynamics/pairs.py", 5, FORMS + RECURSION),
    Target("switching/dynamics/forms.py", 4, FORMS),
    Target("switching/dynamics/interpolation.py", 3, FORMS),
    Target(LAW + "chain.py", 5, LAWS),
    Target(LAW + "fmc1.py", 5, LAWS),
    Target(LAW + "fmc2.py", 5, LAWS),
    Target(LAW + "law.py", 5, LAWS),
    Target(LAW + "integration.py", 4, LAWS),
    Target(LAW + "quadrature.py", 6, LAWS),
    Target(LAW + "cells.py", 3, LAWS),
    Target(LAW + "shares.py", 2, LAWS),
    Target(SPACE + "conversion.py", 12, STATE_SPACE),
    Target(SPACE + "converted.py", 3, STATE_SPACE),
    Target(SPACE + "closeness.py", 3, STATE_SPACE[::-1]),
    Target(SPACE + "cglssm.py", 3, STATE_SPACE),
    Target(SPACE + "space_form.py", 3, ON_NODES[::-1]),
    Target(SPACE + "space_system.py", 3, ON_NODES[1:]),
    Target(SPACE + "parameters.py", 2, ON_NODES[::-1]),
    Target(SPACE + "stationary.py", 4, ON_NODES[::-1]),
    Target(ENGINE + "nodes.py", 10, ON_NODES),
    Target(ENGINE + "nodes_gradient.py", 6, ("engine/numpy/test_nodes_gradient.py",)),
    Target(INFERENCE + "on_nodes.py", 5, ON_NODES[1:]),
    Target("switching/dynamics/exactness.py", 4, PAIRWISE),
    Target("switching/dynamics/joint.py", 3, PAIRWISE[1:]),
    Target("switching/dynamics/pairwise.py", 3, PAIRWISE[::-1]),
    Target(INFERENCE + "joint.py", 3, PAIRWISE[2:]),
    Target(SPACE + "offsets.py", 4, TO_EXACT),
    Target(SPACE + "space_on_nodes.py", 3, TO_EXACT[::-1]),
    Target("possibility/closed_form.py", 5, CLOSED),
    Target("possibility/norms.py", 6, CLOSED[1:] + CLOSED[:1]),
    Target("possibility/memberships/elliptical.py", 4, CLOSED[::-1]),
    Target(ENGINE + "imm.py", 8, IMM),
    Target("kalman/imm.py", 5, IMM),
    Target("kalman/gpb2.py", 2, IMM),
    Target(ENGINE + "kalman.py", 8, KALMAN + IMM),
    Target(ENGINE + "kalman_series.py", 5, KALMAN),
    Target("kalman/updates.py", 3, KALMAN),
    Target("kalman/functions.py", 3, KALMAN),
    Target("kalman/smoothing.py", 2, KALMAN),
    Target("kalman/variants.py", 3, KALMAN),
    Target("kalman/kalman_filter.py", 4, KALMAN),
    Target("kalman/extended.py", 3, KALMAN),
    Target(LEARN + "em.py", 4, LEARNING),
    Target(LEARN + "chains.py", 4, LEARNING),
    Target(LEARN + "gaussians.py", 4, LEARNING),
    Target(LEARN + "regression.py", 4, LEARNING),
    Target(LEARN + "likelihood.py", 3, LEARNING),
    Target(LEARN + "law.py", 2, LEARNING),
    Target(LEARN + "vine.py", 3, LEARNING),
    Target(SOURCE + "switching_body.h", 10, C_RECURSION, unit=CORE + "tables.pyx"),
    Target(SOURCE + "scalar_body.h", 7, C_RECURSION, unit=CORE + "tables.pyx"),
    Target(SOURCE + "backward_body.h", 4, C_RECURSION, unit=CORE + "tables.pyx"),
    Target(SOURCE + "hmm_body.h", 4, C_RECURSION, unit=CORE + "tables.pyx"),
    Target(SOURCE + "lanes_body.h", 2, C_RECURSION, unit=CORE + "tables.pyx"),
    Target(SOURCE + "switching.h", 5, C_RECURSION, "fk_fill|fk_fill_ahead|fk_most.*", CORE + "tables.pyx"),
    Target(SOURCE + "switching.h", 3, C_RECURSION, "fk_first", CORE + "switching.pyx"),
    Target(SOURCE + "switching.h", 5, C_RECURSION[::-1], "fk_far.*|fk_density.*", CORE + "tables.pyx"),
    Target(SOURCE + "hmm_logs.h", 3, C_RECURSION, unit=CORE + "hidden_markov.pyx"),
    Target(SOURCE + "series.h", 4, C_RECURSION, unit=CORE + "series.pyx"),
    Target(SOURCE + "kalman_body.h", 7, C_KALMAN, unit=CORE + "kalman.pyx"),
    Target(SOURCE + "kalman.h", 3, C_KALMAN, unit=CORE + "kalman.pyx"),
    Target(SOURCE + "imm.h", 6, C_KALMAN[1:], unit=CORE + "imm.pyx"),
    Target(
        SOURCE + "nodes_gradient.h",
        6,
        ("engine/compiled/test_nodes_gradient.py",),
        unit=CORE + "nodes_gradient.pyx",
    ),
    Target(CORE + "switching.pyx", 2, C_RECURSION, unit=CORE + "switching.pyx"),
)
