"""Filters that know their model, and how they are written to files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import FileFormatError
from fuzzykf.io import MODELS, Document, decode, encode, flag, number, whole
from fuzzykf.switching.filters.switching_filter import SwitchingFilter
from fuzzykf.switching.inference.mixture import Mixture, Source
from fuzzykf.switching.laws.quadrature import from_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.switching.dynamics.model import SwitchingModel

__all__ = ["SavedFilter"]


class SavedFilter(SwitchingFilter, Document):
    """A filter that knows its model and can be written to a file."""

    model: SwitchingModel

    def _options(self) -> dict[str, Any]:
        """Arguments of the constructor beside the model."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Return model, options and state as plain values.

        Returns
        -------
        dict
        """
        return {
            "model_kind": type(self.model).__name__,
            "model": self.model.to_dict(),
            "options": self._options(),
            "state": self._export_state(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a filter from what `to_dict` returned, in the state it was in.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        filter
            Of this class.
        """
        make: Any = cls
        _check_nodes(values)
        with from_file():
            loaded: Self = make(MODELS[values["model_kind"]].from_dict(values["model"]), **values["options"])
        loaded._import_state(values["state"])
        return loaded

    def _export_state(self) -> dict[str, Any]:
        """Return the state as plain values that `_import_state` restores bit for bit."""
        return {
            "n": self._n,
            "predicted": self._predicted,
            "belief": None if self._mixture is None else self._mixture.to_dict(),
            "before": None if self._before is None else self._before.mixture.to_dict(),
            "z": encode(self._z),
            "log_likelihood": self._log_likelihood,
        } | self._law_before()

    def _law_before(self) -> dict[str, Any]:
        """Return what a system that moves on by itself has come to, before the latest observation."""
        system: Any = self._system  # of a model: it knows what a file has to keep
        law = system.law_to_dict(self._n - 2)
        return {} if law is None else {"law": law}

    def _import_state(self, values: dict[str, Any]) -> None:
        n, belief, before = (
            whole("n", values["n"]),
            *(None if values[k] is None else Mixture.from_dict(values[k]) for k in ("belief", "before")),
        )
        sizes = self.dim_x, self.dim_z, len(self._system.chain), self._system.order
        sound = all(
            one.is_sound(*sizes) and one.window.size == min(seen, sizes[-1]) * self.dim_z
            for one, seen in ((belief, n), (before, n - 1))
            if one is not None
        )
        z, log_likelihood = decode(values["z"], 1), number(values["log_likelihood"])
        if not sound or (belief is None) != (n == 0) or (before is None) != (n < 2):
            raise FileFormatError(f"the state after {n} observations does not fit the model")
        if z.shape != (self.dim_z,) or not np.isfinite(log_likelihood):
            raise FileFormatError(f"z and log_likelihood: got {z.tolist()} and {log_likelihood}")
        predicted = flag("predicted", values["predicted"])
        system: Any = self._system
        system.restore_law(n - 2, values.get("law"))
        self._n, self._predicted, self._mixture = n, predicted, belief
        self._z, self._log_likelihood = z, log_likelihood
        self._before = None if before is None else Source(before, self._system.pair_tables(self._n - 2))


def _check_nodes(values: Mapping[str, Any]) -> None:
    """Refuse a number of nodes that does not go with the state, before tables for so many are made."""
    options, belief = values["options"], values["state"]["belief"]
    if "n_nodes" not in options:
        return
    n_nodes = whole("n_nodes", options["n_nodes"])
    if belief is None:
        return
    M = Mixture.from_dict(belief).table.shape[1]
    if n_nodes >= M:
        raise FileFormatError(f"n_nodes: got {n_nodes}, but the state is one of {M} nodes")
