"""Laws of a stationary fuzzy Markov chain (2020 paper, sections III and V-A).

The switch R lives on [0, 1] with the measure nu = delta_0 + delta_1 + Lebesgue
on ]0, 1[.  A law is a symmetric joint density p(r1, r2) of two consecutive
values with respect to nu x nu: four masses at the corners, densities on the
edges, a density inside.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count, as_numbers, as_real, check_broadcast, check_generator
from fuzzykf.reprs import shown, value_text
from fuzzykf.switching.laws.base import Law, Reach
from fuzzykf.switching.laws.chain import MOST_DRAWS, hardened
from fuzzykf.switching.laws.integration import Lines, cell_masses, integrate_line, invert_line
from fuzzykf.switching.laws.quadrature import discretize
from fuzzykf.switching.laws.registry import LAWS
from fuzzykf.switching.laws.shares import ROUNDING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

    Density: TypeAlias = Callable[..., ArrayLike]
    Edges: TypeAlias = Density | float | Sequence[Density | float]

__all__ = ["FuzzyMarkovLaw"]


#: The hard values of the switch.
_ENDS = np.array([0.0, 1.0])


class FuzzyMarkovLaw(Law):
    """Symmetric law of two consecutive values of a fuzzy switch.

    Create laws by `fmc1`, `fmc2`, `from_durations` or `from_density`; they are immutable.

    Attributes
    ----------
    corners : ndarray, shape (2, 2)
        Masses at (0, 0), (0, 1), (1, 0) and (1, 1).

    Notes
    -----
    Densities are with respect to the fuzzy measure: probabilities at the values 0 and 1 of the switch,
    densities in between.

    References
    ----------
    Bouyahia, Derrode, Pieczynski, "Filtering in Gaussian linear systems with fuzzy
    switches", IEEE Transactions on Fuzzy Systems 28 (2020), section V-A.

    Examples
    --------
    >>> law = FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)
    >>> round(law.beta, 4), round(law.p_hard, 4)
    (0.1583, 0.6667)
    >>> law.discretize(5).transition.shape
    (7, 7)
    """

    corners: FloatArray

    # ------------------------------------------------------------------ construction

    @classmethod
    def fmc1(cls, alpha: float, delta: float, eta: float) -> FuzzyMarkovLaw:
        """Create the law FMC1, with a density that is linear in the distance |r1 - r2|.

        The density is ``alpha`` at (0, 0) and (1, 1), beta at (0, 1) and (1, 0), and
        ``eta + (delta - eta) |r1 - r2|`` elsewhere, with beta from eq. (24).

        Parameters
        ----------
        alpha : float
            Mass of staying in the regime 0, and of staying in the regime 1.
        delta, eta : float
            Density at the largest and at the smallest distance; nonnegative.

        Returns
        -------
        FuzzyMarkovLaw

        Raises
        ------
        ParameterError
            If beta or a density would be negative; the message names the bound.

        See Also
        --------
        FuzzyMarkovLaw.fmc2, fuzzykf.FadeLaw : For a switch that fades.

        Notes
        -----
        Steps of any length are possible, so the switch jumps rather than fades: with the parameters
        (0.07, 0.05, 0.16) of the paper, consecutive values have a correlation of -0.12.

        Examples
        --------
        >>> FuzzyMarkovLaw.fmc1(0.5, 0.05, 0.16)
        Traceback (most recent call last):
            ...
        fuzzykf.errors.ParameterError: alpha: got 0.5, expected a number in [0, 0.228333], \
so that beta (eq. 24) is not negative for delta = 0.05 and eta = 0.16
        """
        return _make("fmc1", alpha, delta, eta)

    @classmethod
    def fmc2(cls, alpha: float, gamma: float, delta: float) -> FuzzyMarkovLaw:
        """Create the law FMC2, with a constant density on the band |r1 - r2| <= delta.

        The density is ``alpha`` at (0, 0) and (1, 1), beta at (0, 1) and (1, 0),
        ``gamma`` elsewhere on the band and zero off it, with beta from eq. (32).

        Parameters
        ----------
        alpha : float
            Mass of staying in the regime 0, and of staying in the regime 1.
        gamma : float
            Density on the band.
        delta : float
            Half width of the band: the largest gradual change of one step, in [0, 1/2[.

        Returns
        -------
        FuzzyMarkovLaw

        Raises
        ------
        ParameterError
            If beta or a density would be negative; the message names the bound.

        Examples
        --------
        >>> law = FuzzyMarkovLaw.fmc2(alpha=0.15, gamma=0.6, delta=0.2)
        >>> round(law.beta, 6), round(law.p_hard, 6)
        (0.002, 0.544)
        """
        return _make("fmc2", alpha, gamma, delta)

    @classmethod
    def from_density(
        cls,
        corners: ArrayLike,
        edges: Edges,
        interior: Density | float,
        *,
        kinks: Sequence[float] = (0.0,),
    ) -> FuzzyMarkovLaw:
        """Create a law from any symmetric density, part by part (Remark 4 of the paper).

        Parameters
        ----------
        corners : array_like, shape (2, 2)
            Masses at the corners, symmetric.
        edges : callable, number, or pair of these
            The density on the open edges.  A pair holds p(0, r) and p(1, r), each a
            function of an array r in ]0, 1[, or a constant.  A single function of two
            arguments is p(i, r) with i in {0, 1}; a single function of one argument, or
            a number, is the density on both edges.
        interior : callable or number
            p(r1, r2) on the open square, symmetric; takes broadcastable arrays.
        kinks : sequence of float
            Lines r2 - r1 = kink, and their mirror images, on which the density has a kink or a jump.
            Integrals are accurate if the density is smooth in between.

        Returns
        -------
        FuzzyMarkovLaw

        Raises
        ------
        ParameterError
            If a part is negative or not symmetric, or if the total mass is not 1
            (within 1e-3, the accuracy of the integral if ``kinks`` is incomplete).

        Examples
        --------
        >>> law = FuzzyMarkovLaw.from_density(
        ...     [[0.2, 0.05], [0.05, 0.2]],
        ...     edges=0.1,
        ...     interior=lambda r1, r2: 0.1 + 0.0 * r1 * r2,
        ... )
        >>> round(law.p_hard, 6)
        0.7
        """
        return _make("from_density", corners, edges, interior, kinks)

    @classmethod
    def from_durations(cls, stay: float, slide: float, *, jump: float = 0.0) -> FuzzyMarkovLaw:
        """Create the law FMC1 or FMC2 that has the given mean durations.

        Parameters
        ----------
        stay : float
            Mean number of steps at a hard value, at least 1.
        slide : float
            Mean number of steps between two hard values, equal or not: in [4/3, 5/3] for FMC1,
            in ]7/4, 2[ for FMC2.  For longer fades, use `FadeLaw.between`.
        jump : float
            Probability, per step at a hard value, of a jump to the other one; less than 1 / stay.

        Returns
        -------
        FuzzyMarkovLaw
            With ``mean_dwell()`` of ``stay`` and ``mean_fade()`` of ``slide``.

        Raises
        ------
        ParameterError
            If neither law has such durations.

        Notes
        -----
        These laws have no direction: most excursions from a hard value return at once, so the mean is below
        two steps.  With f the probability that the switch leaves a hard value gradually, slide = (1 -
        p_hard) / f, which is (5 eta + 4 delta) / (3 eta + 3 delta) for FMC1 and 2 - delta / 2 for FMC2.

        Examples
        --------
        >>> law = FuzzyMarkovLaw.from_durations(stay=20, slide=1.5)
        >>> law.kind, law.mean_dwell().round(9), round(law.mean_fade(), 9)
        ('fmc1', array([20., 20.]), 1.5)
        >>> FuzzyMarkovLaw.from_durations(stay=20, slide=1.9).kind
        'fmc2'
        """
        D, S = (as_real(n, v, "a number of steps") for n, v in (("stay", stay), ("slide", slide)))
        if not (D >= 1.0 and np.isfinite(D)):
            raise ParameterError(f"stay: got {D:.6g}, expected a finite number of steps, at least 1")
        J = as_real("jump", jump, "a probability")
        if not 0.0 <= J < 1.0 / D:
            raise ParameterError(
                f"jump: got {J:.6g}, expected a probability in [0, {1.0 / D:.6g}[, less than 1 / stay, since "
                "the rest of what leaves a hard value slides"
            )
        leave = 1.0 / D - J  # by a slide, per step at a hard value
        p_hard = 1.0 / (1.0 + S * leave)
        alpha, flow = 0.5 * p_hard * (1.0 - 1.0 / D), p_hard * leave
        if 4.0 / 3.0 - ROUNDING <= S <= 5.0 / 3.0 + ROUNDING:
            eta, delta = max(3.0 * S - 4.0, 0.0) * flow, max(5.0 - 3.0 * S, 0.0) * flow
            return cls.fmc1(alpha, delta, eta)
        width = 4.0 - 2.0 * S
        if 0.0 < width < 0.5:
            return cls.fmc2(alpha, flow / (2.0 * width), width)
        raise ParameterError(
            f"slide: got {S:.6g}, expected a mean number of steps in [4/3, 5/3] (FMC1) or ]7/4, 2[ (FMC2), "
            "the only ones that laws of the paper can express, which have no direction; "
            "FadeLaw.between(stay, slide) fades in as many steps as it is told"
        )

    # ------------------------------------------------------------------ the density, part by part

    @abstractmethod
    def _edge(self, corner: FloatArray, r: FloatArray) -> FloatArray:
        """Return p(corner, r) for corner in {0, 1} and r in ]0, 1[."""

    @abstractmethod
    def _interior(self, r1: FloatArray, r2: FloatArray) -> FloatArray:
        """Return p(r1, r2) for r1 and r2 in ]0, 1[."""

    @property
    @abstractmethod
    def lines(self) -> Lines:
        """Lines on which the density is not smooth, and the order of integration in between."""

    # ------------------------------------------------------------------ public densities

    @property
    def beta(self) -> float:
        """Mass at (0, 1) and at (1, 0): a change of regime in one step."""
        return float(self.corners[0, 1])

    @property
    def p_hard(self) -> float:
        """Probability that the switch is 0 or 1 (eqs. 25 and 33)."""
        return float(self.marginal_density(np.array([0.0, 1.0])).sum())

    def joint_density(self, r1: ArrayLike, r2: ArrayLike) -> FloatArray:
        """Return the joint density p(r1, r2) with respect to the product of fuzzy measures.

        Parameters
        ----------
        r1, r2 : array_like
            Values of the switch in [0, 1]; broadcast.

        Returns
        -------
        ndarray
            Joint density, of the broadcast shape.
        """
        a, b = checked_pair(r1, r2)
        hard_a, hard_b = (a == 0.0) | (a == 1.0), (b == 0.0) | (b == 1.0)
        density = np.empty(a.shape)
        both = hard_a & hard_b
        density[both] = self.corners[a[both].astype(int), b[both].astype(int)]
        for mask, corner, r in ((hard_a & ~hard_b, a, b), (hard_b & ~hard_a, b, a)):
            density[mask] = self._edge(corner[mask], r[mask])
        inside = ~hard_a & ~hard_b
        density[inside] = self._interior(a[inside], b[inside])
        return density

    def marginal_density(self, r: ArrayLike) -> FloatArray:
        """Return the marginal density p(r) with respect to the fuzzy measure.

        Parameters
        ----------
        r : array_like
            Values of the switch in [0, 1].

        Returns
        -------
        ndarray
            Same shape as ``r``: probabilities at 0 and 1, densities in between.
        """
        value = checked_switch("r", r)
        flat = value.reshape(-1)
        inner = integrate_line(self.joint_density, flat, 0.0, 1.0, self.lines)
        ends = self.joint_density(flat[:, None], np.array([0.0, 1.0])).sum(axis=1)
        density: FloatArray = (inner + ends).reshape(value.shape)
        return density

    def transition_density(self, r1: ArrayLike, r2: ArrayLike) -> FloatArray:
        """Return the transition density p(r2 | r1) with respect to the fuzzy measure in r2.

        Parameters
        ----------
        r1, r2 : array_like
            Values of the switch before and after; broadcast.

        Returns
        -------
        ndarray
            NaN if ``r1`` has density zero.
        """
        joint = self.joint_density(r1, r2)
        marginal = np.broadcast_to(self.marginal_density(r1), joint.shape)
        undefined = np.full(joint.shape, np.nan)
        density: FloatArray = np.divide(joint, marginal, out=undefined, where=marginal > 0.0)
        return density

    def harden(self, n_nodes: int | None = None) -> FloatArray:
        """Return the joint probabilities of the two hard regimes.

        The law is integrated over the four quadrants of the square, cut at 1/2.

        Parameters
        ----------
        n_nodes : int, optional
            Harden the chain on this many nodes instead; a node at 1/2 counts half for each regime.

        Returns
        -------
        ndarray, shape (2, 2)
            Joint probabilities; they sum to one.

        Examples
        --------
        >>> FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16).harden().round(4)
        array([[0.2379, 0.2621],
               [0.2621, 0.2379]])
        """
        if n_nodes is not None:
            return hardened(self.discretize(n_nodes))
        masses = cell_masses(self, np.array([0.0, 0.5, 1.0]))
        halves = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
        joint: FloatArray = halves @ masses @ halves.T
        return joint

    def reach(self, n: int) -> Reach:
        """Return the hard values and ``n`` values between them, and which may follow which.

        Parameters
        ----------
        n : int
            Number of values strictly between 0 and 1.

        Returns
        -------
        Reach
        """
        r = np.concatenate([[0.0], (np.arange(n) + 0.5) / n, [1.0]])
        possible = self.joint_density(r[:, None], r) > 0.0
        return Reach(np.stack([1.0 - r, r], axis=1), possible, self.marginal_density(r) > 0.0)

    # ------------------------------------------------------------------ derived objects

    def discretize(self, n_nodes: int, rule: str = "cell") -> SwitchChain:
        """Approximate the law by a Markov chain on finitely many nodes.

        Parameters
        ----------
        n_nodes : int
            Number F of nodes strictly between 0 and 1.  The cost of a filter
            step is proportional to (F + 2)^2.
        rule : {"cell", "midpoint", "gauss", "product"}
            Quadrature rule: exact integrals over cells, density at midpoints, density at Gauss-Legendre
            nodes, or product integration.

        Returns
        -------
        SwitchChain
            Chain on F + 2 nodes, including 0 and 1.

        Raises
        ------
        ParameterError
            If ``n_nodes`` is negative, above 1000, or too small for the rule: "product" needs a node
            on each panel; "midpoint" and "gauss" need nodes closer together than the width of the band.
        """
        return discretize(self, n_nodes, rule)

    def sample(self, n: int, rng: np.random.Generator, n_nodes: int | None = None) -> FloatArray:
        """Draw ``n`` consecutive values of the stationary chain, exactly.

        Parameters
        ----------
        n : int
            Number of values.
        rng : numpy.random.Generator
        n_nodes : int, optional
            Draw from the chain on this many nodes instead.

        Returns
        -------
        ndarray, shape (n,)
            Values in [0, 1]; exactly 0 or 1 where hard.

        Examples
        --------
        >>> import numpy as np
        >>> r = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2).sample(5, np.random.default_rng(1))
        >>> bool(((r >= 0) & (r <= 1)).all())
        True
        """
        if n_nodes is not None:
            return self.discretize(n_nodes).sample(n, rng)
        check_generator(rng)
        n = as_count("n", n, most=MOST_DRAWS)
        uniforms = rng.random((n, 2))
        chain = np.empty(n)
        if n:
            ends = self.marginal_density(np.array([0.0, 1.0]))
            first, second = (float(u) for u in uniforms[0])
            if first < ends.sum():
                chain[0] = 0.0 if first < ends[0] else 1.0
            else:
                chain[0] = invert_line(self.marginal_density, second, self.lines.breaks)
        for k in range(1, n):
            chain[k] = self._draw_next(float(chain[k - 1]), *map(float, uniforms[k]))
        return chain

    def _draw_next(self, r: float, which: float, where: float) -> float:
        """Map two uniform numbers to a value that follows ``r``."""
        # the joint density without its checks, which cost more than it does
        ends = self.corners[int(r)] if r in (0.0, 1.0) else self._edge(_ENDS, np.array([r, r]))
        to_zero, to_one = ends.tolist()
        inside = self._inner_mass(r)
        which *= to_zero + to_one + inside
        if which < to_zero:
            return 0.0
        if which < to_zero + to_one:
            return 1.0
        return self._draw_inside(r, where)

    def _inner_mass(self, r: float) -> float:
        return float(integrate_line(self.joint_density, np.array([r]), 0.0, 1.0, self.lines)[0])

    def _draw_inside(self, r: float, u: float) -> float:
        """Invert the distribution function of the values in ]0, 1[ that follow ``r``."""
        cuts = np.concatenate([self.lines.breaks, np.clip(r + self.lines.kinks, 0.0, 1.0)])
        return invert_line(lambda s: self.joint_density(r, s), u, np.unique(cuts))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the joint density as bars, as in figure 2 of the paper.

        Parameters
        ----------
        ax : matplotlib 3-D axes, optional
            By default those of a new figure.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.laws import plot_law

        return plot_law(self, ax)

    # ------------------------------------------------------------------ value semantics

    @shown
    def __repr__(self) -> str:
        arguments = ", ".join(
            f"{name}={f'{value:.6g}' if isinstance(value, float) else value_text(value)}"
            for name, value in (self.parameters or {"corners": self.corners}).items()
        )
        made_by = f"FuzzyMarkovLaw.{self.kind}" if hasattr(FuzzyMarkovLaw, self.kind) else type(self).__name__
        return f"{made_by}({arguments})"


def _make(kind: str, *arguments: Any) -> FuzzyMarkovLaw:
    law: FuzzyMarkovLaw = LAWS[kind](*arguments)
    return law


def checked_switch(name: str, r: ArrayLike) -> FloatArray:
    value = as_numbers("r", r)
    if not ((value >= 0.0) & (value <= 1.0)).all():
        bad = value[~((value >= 0.0) & (value <= 1.0))].reshape(-1)[0]
        raise ParameterError(f"{name}: got {bad}, expected values of the switch in [0, 1]")
    return value


def checked_pair(r1: ArrayLike, r2: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return two switches that have been checked, broadcast against one another."""
    a, b = checked_switch("r1", r1), checked_switch("r2", r2)
    check_broadcast(r1=a, r2=b)
    first, second = np.broadcast_arrays(a, b)
    return first, second
