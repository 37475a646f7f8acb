"""What a fuzzy switch is worth where a sensor or a motion fades, and what it costs where all is abrupt.

The parameters of both classes are known to all filters.  The fuzzy switch is told how long stays and fades
are meant to last, and learns nothing, whatever the fades are; its rivals are tuned or fitted on series of
their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize

from fuzzykf import (
    ExtendedKalmanFilter,
    FadeLaw,
    KnownSwitchFilter,
    SwitchChain,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)

pytestmark = pytest.mark.study

#: Series on which the rivals are fitted, the steps of each that are used for it, and those for tuning.
LESSONS, FITTED_STEPS, TUNING = 40, 100, 10

#: First steps of each series, that do not count.
SETTLING = 5

#: Evaluations of the likelihood in a fit, at most.
MOST = 250

#: Steps at 0 or 1: a geometric number of this mean, and so many more.
DWELL, LEAST = 60, 5

#: Steps of a fade.
LENGTHS = (20, 1)

#: Nodes between the classes.
NODES = 5

LAW = FadeLaw.between(DWELL, 20, jump=0.005)


# --------------------------------------------------------------------------- the systems


class System(NamedTuple):
    """Parameters at r between 0 and 1, each an array or a function of r; components that count."""

    F: object
    Q: object
    H: object
    R: object
    x0: object
    P0: object
    b: object
    d: object
    counted: tuple[int, ...] = (0,)
    steps: int = 300
    runs: int = 100

    def at(self, name, r):
        value = getattr(self, name)
        return np.asarray(value(r) if callable(value) else value, dtype=float)

    def model(self, law, values=(0.0, 1.0), noise=(1.0, 1.0), push=(1.0, 1.0)):
        """Model under a law, whose classes are values of r; R and Q of each may have a factor."""

        def parameter(name, factors=None):
            return lambda w: self.at(name, w @ values) * (1.0 if factors is None else w @ factors)

        plain = {name: parameter(name) for name in ("F", "H", "b", "d")}
        covariances = {"Q": parameter("Q", push), "R": parameter("R", noise)}
        return SwitchingStateSpace(law, **plain, **covariances, x0=self.x0, P0=self.P0)


def between(a, b):
    """Linear in r."""
    a, b = np.array(a), np.array(b)
    return lambda r: (1.0 - r) * a + r * b


def geometric(a, b, q=1):
    """Variances of q measurements whose standard deviations are geometric in r."""
    return lambda r: (a * (b / a) ** r) ** 2 * np.eye(q)


def turning(r):
    """A second of a coordinated turn at r times 9 degrees a second."""
    rate = np.deg2rad(9.0) * r
    cosine, sine = np.cos(rate), np.sin(rate)
    along, across = np.sinc(rate / np.pi), 0.5 * rate * np.sinc(0.5 * rate / np.pi) ** 2
    return np.array(
        [
            [1.0, along, 0.0, -across],
            [0.0, cosine, 0.0, -sine],
            [0.0, across, 1.0, along],
            [0.0, sine, 0.0, cosine],
        ]
    )


def one(value):
    """A matrix of one row and column."""
    return np.full((1, 1), value)


PUSH = np.kron(np.eye(2), [[0.5], [1.0]])
ANYWHERE = np.diag([100.0, 15.0, 100.0, 15.0]) ** 2

SYSTEMS = {
    "gain": System(
        one(0.99), one(0.3**2), between(one(1.0), one(0.3)), one(0.5**2), [10.0], one(4.0), b=[0.1], d=[0.0]
    ),
    "bias": System(
        one(0.98), one(0.2**2), one(1.0), one(0.7**2), [0.0], one(1.0), b=[0.0], d=between([0.0], [5.0])
    ),
    "sun": System(
        one(0.95),
        one(0.3**2),
        between(one(1.0), one(0.4)),
        geometric(0.2, 0.6),
        [0.0],
        one(0.92),
        b=[0.0],
        d=between([0.0], [2.0]),
    ),
    "noise": System(
        one(0.95), one(0.3**2), one(1.0), geometric(0.3, 3.0), [0.0], one(0.92), b=[0.0], d=[0.0]
    ),
    "turn": System(
        turning,
        0.2**2 * PUSH @ PUSH.T,
        np.eye(4)[[0, 2]],
        np.eye(2),
        np.zeros(4),
        ANYWHERE,
        b=np.zeros(4),
        d=np.zeros(2),
        counted=(1, 3),
        steps=200,
        runs=60,
    ),
    "tsun": System(
        turning(0.0),
        PUSH @ PUSH.T,
        np.eye(4)[[0, 2]],
        geometric(4.0, 12.0, 2),
        np.zeros(4),
        ANYWHERE,
        b=np.zeros(4),
        d=between([0.0, 0.0], [30.0, 0.0]),
        counted=(0, 1, 2, 3),
        runs=60,
    ),
}


def ramps(n, length, rng):
    """Stays of random length; between them even steps, of which the last one arrives."""
    up, pieces, k = np.arange(1, length + 1) / length, [], int(rng.integers(2))
    forgotten = 10 * (DWELL + LEAST + length)  # so that a series begins anywhere in a stay or a ramp
    while sum(map(len, pieces)) < forgotten + n:
        stay = rng.geometric(1.0 / DWELL) + LEAST
        pieces += [np.full(stay, float(k)), up if k == 0 else 1.0 - up]
        k = 1 - k
    return np.concatenate(pieces)[forgotten : forgotten + n]


class Series(NamedTuple):
    """Series side by side, (runs, n, ...)."""

    x: np.ndarray
    y: np.ndarray
    r: np.ndarray


def draw(name, length, runs, *seed):
    system = SYSTEMS[name]
    rng = np.random.default_rng([list(SYSTEMS).index(name), length, *seed])
    form = system.model(LAW).form
    paths = [ramps(system.steps, length, rng) for _ in range(runs)]
    drawn = [form.simulate(np.stack([1.0 - r, r], axis=1), r, rng) for r in paths]
    return Series(np.stack([s.x for s in drawn]), np.stack([s.y for s in drawn]), np.stack(paths))


# --------------------------------------------------------------------------- the filters
# Each takes observations (runs, n, q) and returns estimates (runs, n, m).


def switching(model, n_nodes=NODES):
    """IMM on the nodes of the law."""
    f = SwitchingKalmanFilter(model, n_nodes=n_nodes)
    return lambda y: f.filter_many(y, keep=("x",)).x


def known(system, r):
    """Kalman filter along a switch that is told: (runs, n)."""
    f = KnownSwitchFilter(system.model(LAW))
    return lambda y: f.filter_many(y, keep=("x",), r=r).x


def kalman(system, r):
    """One Kalman filter, that of a value of the switch."""
    return switching(system.model([[1.0]], (r,), (1.0,), (1.0,)))


def no_filter(system):
    """Mean of the state, whatever is seen; of a target that turns, as if it went straight on."""

    def estimate(y):
        x = np.empty((y.shape[1], len(np.atleast_1d(system.x0))))
        x[0] = system.x0
        for n in range(1, len(x)):
            x[n] = system.at("F", 0.0) @ x[n - 1] + system.at("b", 0.0)
        return np.broadcast_to(x, (len(y), *x.shape))

    return estimate


def leaving(p, n=2):
    """Transition probabilities of n classes, each of them left with p for any other."""
    return (1.0 - p) * np.eye(n) + p / (n - 1) * (1.0 - np.eye(n))


def seven_modes(system, p):
    """Seven values of the switch, each of them left with p for any other."""
    n = 7
    chain = SwitchChain(np.linspace(0.0, 1.0, n), np.ones(n), np.full(n, 1.0 / n), leaving(p, n))
    return switching(system.model(chain))


class WithSwitch(ExtendedKalmanFilter):
    """State and switch r, which wanders: r' - 1/2 = a (r - 1/2) + N(0, q).  R is that at its estimate."""

    def __init__(self, system, q, a):
        m = len(np.atleast_1d(system.x0))
        F, H, b, d = (lambda r, name=name: system.at(name, r) for name in ("F", "H", "b", "d"))

        def slope(matrix, r):
            return (matrix(r + 1e-4) - matrix(r - 1e-4)) / 2e-4

        def fx(x):
            return np.append(F(x[m]) @ x[:m] + b(x[m]), 0.5 + a * (x[m] - 0.5))

        def FJacobian(x):
            top = np.column_stack([F(x[m]), slope(F, x[m]) @ x[:m] + slope(b, x[m])])
            return np.vstack([top, np.append(np.zeros(m), a)])

        def hx(x):
            return H(x[m]) @ x[:m] + d(x[m])

        def HJacobian(x):
            return np.column_stack([H(x[m]), slope(H, x[m]) @ x[:m] + slope(d, x[m])])

        self.system, self.m = system, m
        self.first = np.append(system.x0, 0.5), np.pad(system.P0, (0, 1))
        self.first[1][m, m] = 0.25
        Q = np.pad(system.at("Q", 0.0), (0, 1))
        Q[m, m] = q
        seen = len(system.at("R", 0.0))
        super().__init__(m + 1, seen, fx=fx, FJacobian=FJacobian, hx=hx, HJacobian=HJacobian, Q=Q)

    def __call__(self, y):
        found = np.empty((*y.shape[:2], self.m))
        for series, x in zip(y, found, strict=True):
            self.x, self.P = self.first
            for n, z in enumerate(series):
                if n:  # to the first observation nothing moves
                    self.predict()
                self.update(z, R=self.system.at("R", float(np.clip(self.x[self.m], 0.0, 1.0))))
                x[n] = self.x[: self.m]
        return found


def refitted(system, y):
    """Hard IMM of large likelihood: where its classes stand, their noises, and how often they are left.

    The search is short, and may end before the largest one.
    """

    def model(numbers):
        noise, push = np.exp(numbers[2:6]).reshape(2, 2)
        return system.model(leaving(1.0 / (1.0 + np.exp(-numbers[6]))), numbers[:2], noise, push)

    def loss(numbers):
        if np.abs(numbers[2:6]).max() > 6.0 or not -12.0 < numbers[6] < 0.0:
            return np.inf
        f = SwitchingKalmanFilter(model(numbers))
        return -f.filter_many(y, keep=("log_likelihood",)).log_likelihood.sum()

    start = np.array([0.1, 0.9, 0.0, 0.0, 0.0, 0.0, -4.0])
    simplex = start + np.vstack([np.zeros(7), np.diag([0.15, -0.15, 0.5, 0.5, 0.5, 0.5, 1.0])])
    options = {"maxfev": MOST, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 0.1}
    return switching(model(minimize(loss, start, method="Nelder-Mead", options=options).x))


def errors(estimate, data, counted):
    """Squared errors (runs,)."""
    off = (estimate - data.x)[:, SETTLING:, list(counted)]
    return (off**2).sum(axis=-1).mean(axis=-1)


def best(candidates, lesson, system):
    """Of filters by name that with the smallest error on the lessons."""
    found = {name: errors(f(lesson.y), lesson, system.counted).mean() for name, f in candidates.items()}
    name = min(found, key=found.get)
    return name, candidates[name]


FUZZY, KNOWN = "fuzzy", "known switch"


def all_filters(system, length, lesson, data):
    """Filters by name, and what was chosen for some of them."""
    tuning = Series(*(part[:TUNING] for part in lesson))
    one_for_all = {f"r = {r:g}": kalman(system, r) for r in (0.0, 0.5, 1.0)}
    modes = {f"p = {p:g}": seven_modes(system, p) for p in (0.01, 0.03, 0.1, 0.3)}
    walks = {
        f"q = {q:g}, a = {a:g}": WithSwitch(system, q, a)
        for q in (1e-4, 1e-3, 1e-2, 3e-2)
        for a in (1.0, 0.98)
    }
    tuned = {
        "one Kalman filter": best(one_for_all, tuning, system),
        "IMM, seven modes": best(modes, tuning, system),
        "EKF, the switch a state": best(walks, tuning, system),
    }
    filters = {
        "no filter": no_filter(system),
        "one Kalman filter": tuned["one Kalman filter"][1],
        "hard IMM, true classes": switching(system.model(leaving(1.0 / (DWELL + LEAST + length)))),
        "hard IMM, refitted": refitted(system, lesson.y[:, :FITTED_STEPS]),
        "IMM, seven modes": tuned["IMM, seven modes"][1],
        "EKF, the switch a state": tuned["EKF, the switch a state"][1],
        FUZZY: switching(system.model(LAW)),
        KNOWN: known(system, data.r),
    }
    return filters, {name: choice for name, (choice, _) in tuned.items()}


# --------------------------------------------------------------------------- what they find


def mean(values):
    error = values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.3g} ({error:.2g})"


def ratio(a, b):
    """Ratio of means of paired samples, and its standard error."""
    value = a.mean() / b.mean()
    return value, (a - value * b).std(ddof=1) / np.sqrt(len(a)) / b.mean()


def found_with(length):
    """Errors of all filters by system, and the tuned choices."""
    found, choices = {}, {}
    for name, system in SYSTEMS.items():
        data, lesson = draw(name, length, system.runs, 0), draw(name, length, LESSONS, 1)
        filters, choices[name] = all_filters(system, length, lesson, data)
        found[name] = {row: errors(f(data.y), data, system.counted) for row, f in filters.items()}
    return found, choices


def to_best_rival(found):
    """Name of the rival with the smallest error on the very series, and the ratio to it."""
    rivals = [row for row in found if row not in (FUZZY, KNOWN)]
    name = min(rivals, key=lambda row: found[row].mean())
    return name, ratio(found[FUZZY], found[name])


#: What the ratio to the best rival is at most, where anything is promised.
PROMISED = {
    20: {"gain": 0.30, "bias": 0.48, "sun": 0.75, "turn": 0.80, "tsun": 0.88},
    1: {"sun": 1.12, "turn": 1.12, "tsun": 1.12},
}


def test_what_a_fuzzy_switch_is_worth_where_sensors_and_motions_fade(write_table):
    rows, ratios = [], {}
    for length in LENGTHS:
        found, choices = found_with(length)
        for filter_name in found["gain"]:
            cells = []
            for name, errors_of in found.items():
                chosen = choices[name].get(filter_name)
                cells.append(mean(errors_of[filter_name]) + (f"; {chosen}" if chosen else ""))
            rows.append([str(length), filter_name, *cells])
        compared = {name: to_best_rival(errors_of) for name, errors_of in found.items()}
        rows.append([str(length), "best rival", *(rival for rival, _ in compared.values())])
        texts = [f"{value:.2f} ({error:.2f})" for _, (value, error) in compared.values()]
        rows.append([str(length), "fuzzy to it", *texts])
        ratios[length] = {name: value for name, (_, (value, _)) in compared.items()}
    write_table("fading_sensor", ["steps of a fade", "filter", *SYSTEMS], rows)

    for length, promised in PROMISED.items():
        for name, most in promised.items():
            assert ratios[length][name] <= most, (length, name)
