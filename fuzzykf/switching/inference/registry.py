"""The methods of filtering by name: the one list of them, which filters read."""

from __future__ import annotations

from fuzzykf.registry import Registry

__all__ = ["METHODS"]

#: Methods by the names under which they are chosen.
METHODS = Registry(
    {
        "exact": "fuzzykf.switching.inference.exact:EXACT",
        "imm": "fuzzykf.switching.inference.on_nodes:IMM",
        "gpb2": "fuzzykf.switching.inference.on_nodes:GPB2",
        "joint_imm": "fuzzykf.switching.inference.joint:JOINT_IMM",
        "joint_gpb2": "fuzzykf.switching.inference.joint:JOINT_GPB2",
    }
)
