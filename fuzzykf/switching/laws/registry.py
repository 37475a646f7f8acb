"""The families of laws: the one list of them.

Constructors, files, the learner and the command line read it.
"""

from __future__ import annotations

from fuzzykf.registry import Registry

__all__ = ["LAWS", "learned_laws"]

#: Classes of laws by their kind.
LAWS = Registry(
    {
        "fmc1": "fuzzykf.switching.laws.fmc1:FMC1",
        "fmc2": "fuzzykf.switching.laws.fmc2:FMC2",
        "free": "fuzzykf.switching.laws.cells:CellLaw",
        "from_density": "fuzzykf.switching.laws.density:DensityLaw",
        "fade": "fuzzykf.switching.laws.fades:FadeLaw",
        "graph": "fuzzykf.switching.laws.graph:GraphLaw",
        "chain": "fuzzykf.switching.laws.chains:ChainLaw",
    }
)


def learned_laws() -> tuple[str, ...]:
    """Return the kinds of laws that can be learned by name, between two classes."""
    return tuple(kind for kind, law in LAWS.items() if law.learned)
