"""What observations say of switch and state: filters and smoothers as functions on systems."""
