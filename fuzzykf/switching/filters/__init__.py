"""The filters, as users meet them."""
