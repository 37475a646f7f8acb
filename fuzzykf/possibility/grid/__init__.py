"""Memberships on grids: warps, sup-convolutions, conditioning."""
