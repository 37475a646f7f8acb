"""The switching state-space model in its usual form (CGLSSM), as users bring it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import NotStableError, ParameterError, ShapeError
from fuzzykf.gaussian import as_array, check_covariance, semidefinite_root, square
from fuzzykf.reprs import shown
from fuzzykf.results import Simulation
from fuzzykf.switching.laws.chain import SUM_TOLERANCE, SwitchChain, stationary_distribution
from fuzzykf.switching.state_space import conversion
from fuzzykf.switching.state_space.controls import read_controls
from fuzzykf.switching.state_space.conversion import StateSpace
from fuzzykf.switching.state_space.model import SwitchingStateSpace

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["CGLSSM"]


class CGLSSM(SwitchingStateSpace):
    """Conditionally Gaussian linear state-space model: a linear system whose regime is a Markov chain.

    A `SwitchingStateSpace` with hard regimes and without offsets, in the notation of the papers.

    With j the regime at the new time,

        X' = A_j X + C_j U,    Y' = B_j X' + D_j V,

    with U and V standard normal.  At the first observation, X has mean zero given the regime.

    Parameters
    ----------
    transition : array_like, shape (K, K)
        ``transition[i, j]`` is the probability of regime j after regime i.
    A : array_like, shape (K, m, m)
        Transition matrix of the state in each regime.
    B : array_like, shape (K, q, m)
        Observation matrix.
    C : array_like, shape (K, m, s)
        Factor of the covariance C C' of the state noise.
    D : array_like, shape (K, q, t)
        Factor of the covariance D D' of the observation noise.
    initial_probability : array_like, shape (K,), optional
        Probability of the regimes at the first observation; the stationary one by default.
    initial_covariance : array_like, shape (K, m, m), optional
        Covariance of X given the regime, at the first observation; the stationary one
        by default, which exists if `spectral_radius` is below one.

    Attributes
    ----------
    transition, initial_probability, A, B, C, D, initial_covariance : ndarray
        As given; read-only.
    n_classes, dim_x, dim_z : int
        Numbers K of regimes, m of states, q of observations.

    Raises
    ------
    ShapeError, ParameterError
        If shapes do not agree, or probabilities do not sum to one.
    NotPositiveDefiniteError
        If an initial covariance is indefinite.
    NotStableError
        If no initial covariance is given, and there is no stationary one.

    Notes
    -----
    The covariances of X and Y follow from A, B, C and D (2013 paper, equation (18)).  For an exact
    filter, approximate the model by `CGOMSModel.from_cglssm`.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.switching import CGLSSM
    >>> system = CGLSSM(
    ...     [[0.95, 0.05], [0.10, 0.90]],
    ...     A=[[[0.9]], [[0.5]]],
    ...     B=[[[1.0]], [[1.0]]],
    ...     C=[[[0.3]], [[1.0]]],
    ...     D=[[[0.5]], [[0.5]]],
    ... )
    >>> truth = system.simulate(100, np.random.default_rng(0))
    >>> truth.x.shape, truth.y.shape, truth.r.shape
    ((100, 1), (100, 1), (100,))
    >>> system.initial_covariance[:, 0, 0].round(3)
    array([0.621, 1.31 ])
    """

    #: A CGLSSM has no offsets, and mean zero.
    offsets: None = None
    initial_mean: None = None

    def __init__(
        self,
        transition: ArrayLike,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike,
        *,
        initial_probability: ArrayLike | None = None,
        initial_covariance: ArrayLike | None = None,
    ) -> None:
        self.chain = _chain(transition, initial_probability)
        K = len(self.chain)
        state = as_array("A", A, (K, None, None))
        m = state.shape[-1]
        state = as_array("A", state, (K, m, m))
        seen = as_array("B", B, (K, None, m))
        q = seen.shape[1]
        if m == 0 or q == 0:
            name = "A" if m == 0 else "B"
            raise ShapeError(f"{name}: got no components, expected at least one state and one observation")
        self.space = StateSpace(state, seen, as_array("C", C, (K, m, None)), as_array("D", D, (K, q, None)))
        if initial_covariance is None:
            covariance = self._default_covariance()
        else:
            covariance = check_covariance("initial_covariance", initial_covariance, (K, m, m))
        self.initial_covariance = covariance
        noise = square(self.space.C), square(self.space.D)
        super().__init__(self.chain, state, seen, *noise, x0=np.zeros(m), P0=covariance)

    @property
    def transition(self) -> FloatArray:
        """Transition probabilities of the regimes, (K, K)."""
        return self.chain.transition

    @property
    def initial_probability(self) -> FloatArray:
        """Probabilities of the regimes at the first observation, (K,)."""
        return self.chain.initial

    @property
    def A(self) -> FloatArray:
        """Transition matrices of the state, (K, m, m)."""
        return self.space.A

    @property
    def B(self) -> FloatArray:
        """Observation matrices, (K, q, m)."""
        return self.space.B

    @property
    def C(self) -> FloatArray:
        """Factors of the covariance of the state noise, (K, m, s)."""
        return self.space.C

    @property
    def D(self) -> FloatArray:
        """Factors of the covariance of the observation noise, (K, q, t)."""
        return self.space.D

    # ------------------------------------------------------------------ second moments

    @property
    def starts_stationary(self) -> bool:
        """Whether the initial probabilities of the regimes are stationary."""
        after = self.initial_probability @ self.transition
        return bool(np.allclose(after, self.initial_probability, rtol=0.0, atol=SUM_TOLERANCE))

    def _stationary_kernel(self) -> FloatArray:
        """p(r_n = i | r_{n+1} = j) in the long run."""
        p = self.initial_probability
        if not self.starts_stationary:
            p = stationary_distribution(self.transition)
        with np.errstate(divide="ignore"):
            return conversion.backward_kernel(np.log(p), self.transition)[0]

    @property
    def spectral_radius(self) -> float:
        """Asymptotic growth factor of the second moments of X per step.

        The spectral radius of the matrix with p(r_n = i | r_{n+1} = j) A_j (x) A_j in block
        row j and column i.  The model is mean-square stable if it is below one.
        """
        operator = conversion.moment_operator(self._stationary_kernel(), self.A)
        return float(np.abs(np.linalg.eigvals(operator)).max())

    def stationary_covariance(self) -> FloatArray:
        """Return the stationary covariance of X given each regime, (K, m, m).

        It is the fixed point of recursion (18) of the paper.  For a regime that does not occur in the
        stationary law, it is the noise covariance C C'.

        Returns
        -------
        ndarray, shape (K, m, m)

        Raises
        ------
        NotStableError
            If `spectral_radius` is not below one.
        """
        radius = self.spectral_radius
        if not radius < 1.0:
            raise NotStableError(
                "A: no stationary covariance exists, since the spectral radius of p(i | j) A_j (x) A_j is "
                f"{radius:.6g}, expected less than 1"
            )
        return conversion.stationary_covariance(self._stationary_kernel(), self.A, self.C)

    def _default_covariance(self) -> FloatArray:
        try:
            G = self.stationary_covariance()
        except ParameterError as error:
            raise type(error)(f"initial_covariance: has to be given ({error})") from None
        passing = (self.initial_probability > 0.0) & ~self._stationary_kernel().any(axis=0)
        if passing.any():
            raise ParameterError(
                f"initial_covariance: has to be given, since the regime {int(np.argmax(passing))} does not "
                "occur in the long run and has no stationary covariance"
            )
        return G

    def check_stationary(self) -> None:
        """Raise an error unless regimes and covariances start in their stationary law.

        Raises
        ------
        NotStableError
            If there is no stationary covariance.
        ParameterError
            If the initial probability or the initial covariance is not stationary.
        """
        advice = "expected the stationary one (leave it out), or mode='time_varying'"
        if not self.starts_stationary:
            after = self.initial_probability @ self.transition
            raise ParameterError(
                f"initial_probability: got {self.initial_probability}, one step later {after}; {advice}"
            )
        G = self.stationary_covariance()
        there = self.initial_probability > 0.0
        scale = np.abs(G).max(axis=(1, 2))
        error = np.where(there, np.abs(self.initial_covariance - G).max(axis=(1, 2)), 0.0)
        if (error > 1e-6 * scale).any():
            k = int(np.argmax(error / np.where(scale > 0.0, scale, 1.0)))
            raise ParameterError(
                f"initial_covariance[{k}]: differs from the stationary covariance by {error[k]:.3g}; {advice}"
            )

    # ------------------------------------------------------------------ simulation

    def simulate(
        self, n: int, rng: np.random.Generator, n_nodes: int | None = None, us: None = None
    ) -> Simulation:
        """Simulate regimes, states and observations.

        Parameters
        ----------
        n : int
            Number of observations.
        rng : numpy.random.Generator
        n_nodes : int, optional
            Ignored: a hard switch has no values between the regimes.
        us : None
            Must be None: the model has no controls.

        Returns
        -------
        Simulation
            ``x`` (n, m), ``y`` (n, q) and ``r`` (n,) with regimes 0, ..., K - 1.
        """
        read_controls(us, n, self, begins=True)
        r = self.chain.sample(n, rng)
        n, j = len(r), r.astype(np.intp)
        A, B, C, D = self.space
        x = (C[j] @ rng.standard_normal((n, C.shape[-1], 1)))[..., 0]
        if n:
            x[0] = semidefinite_root(self.initial_covariance[j[0]]) @ rng.standard_normal(self.dim_x)
        for k in range(1, n):
            x[k] += A[j[k]] @ x[k - 1]
        y = (B[j] @ x[..., None] + D[j] @ rng.standard_normal((n, D.shape[-1], 1)))[..., 0]
        return Simulation(x, y, r)

    # ------------------------------------------------------------------ values

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments of the constructor as plain lists.

        Returns
        -------
        dict
        """
        return {
            "transition": self.transition.tolist(),
            **{name: getattr(self, name).tolist() for name in "ABCD"},
            "initial_probability": self.initial_probability.tolist(),
            "initial_covariance": self.initial_covariance.tolist(),
        } | self._labels_to_dict()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Create a model from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        CGLSSM
        """
        names = ("transition", *"ABCD", "initial_probability", "initial_covariance")
        return cls(**{name: values[name] for name in names})._labelled_from(values)

    @shown
    def __repr__(self) -> str:
        return f"CGLSSM(n_classes={self.n_classes}, dim_x={self.dim_x}, dim_z={self.dim_z})"


def _chain(transition: ArrayLike, initial_probability: ArrayLike | None) -> SwitchChain:
    try:
        return SwitchChain.from_classes(transition, initial_probability)
    except ParameterError as error:
        message = str(error)
        if message.startswith("initial:"):  # the chain's name of the argument
            raise type(error)(f"initial_probability{message.removeprefix('initial')}") from None
        raise
