"""What one part of the harness found."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["Report"]


@dataclass
class Report:
    """What a part tried, and what went wrong.

    Attributes
    ----------
    title : str
        What was tried, in a few words.
    figures : dict of str to int, float or str
        What was counted and measured, by a name that reads well in a table.
    faults : list of str
        Everything that must not be, each with what is needed to see it again; empty where all is well.
    """

    title: str
    figures: dict[str, int | float | str] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    def lines(self, name: str, seconds: float) -> list[str]:
        """Show the report in Markdown: a heading, the figures, the first faults."""
        told = [f"## {name}: {self.title}", ""]
        told += [f"- {what}: {figure}" for what, figure in self.figures.items()]
        told += [f"- faults: {len(self.faults)}", f"- seconds: {seconds:.0f}", ""]
        told += [f"    {fault}" for fault in self.faults[:SHOWN]]
        if len(self.faults) > SHOWN:
            told.append(f"    and {len(self.faults) - SHOWN} more")
        return told


#: How many faults of a part are shown.
SHOWN = 50
