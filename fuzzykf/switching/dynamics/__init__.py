"""What Z = (X, Y) does at a pair of nodes of the switch."""
