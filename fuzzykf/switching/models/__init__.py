"""The models, as users make them."""
