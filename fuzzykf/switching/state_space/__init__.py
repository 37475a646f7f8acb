"""Switching state-space models, and their conversion to models that can be filtered exactly."""
