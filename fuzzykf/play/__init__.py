"""A page to play with: sliders move a fading switch, and the estimates of three filters follow.

`fuzzykf.play.scene` computes what the page shows, `fuzzykf.play.server` serves it to this machine alone.
"""
