"""Real series to try filters on: one comes with the package, others from a folder of yours.

`load_victoria` is packaged. `load_building` and `load_traffic` read files that
are not part of the package, from the folder that the environment variable
``FUZZYKF_DATA`` names.
"""

from __future__ import annotations

from fuzzykf.datasets.series import (
    Building,
    Traffic,
    Victoria,
    load_building,
    load_traffic,
    load_victoria,
)
from fuzzykf.datasets.table import Table, read_table

__all__ = [
    "Building",
    "Table",
    "Traffic",
    "Victoria",
    "load_building",
    "load_traffic",
    "load_victoria",
    "read_table",
]
