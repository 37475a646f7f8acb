"""Real series to try filters on: some come with the package, others from a folder of yours.

`load_victoria` and `load_weather` are packaged. `load_building`, `load_traffic`, and `load_weather`
of another station, read files that are not part of the package, from the folder that the environment
variable ``FUZZYKF_DATA`` names.
"""

from __future__ import annotations

from fuzzykf.datasets.series import (
    Building,
    Traffic,
    Victoria,
    Weather,
    load_building,
    load_traffic,
    load_victoria,
    load_weather,
)
from fuzzykf.datasets.table import Table, read_table

__all__ = [
    "Building",
    "Table",
    "Traffic",
    "Victoria",
    "Weather",
    "load_building",
    "load_traffic",
    "load_victoria",
    "load_weather",
    "read_table",
]
