"""Sets of possible states: intervals and boxes."""
