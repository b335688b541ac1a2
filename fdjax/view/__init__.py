DRAW = "fdjax.view.figures:draw"
"""Saves a picture: for who does not load Matplotlib itself; see `fdjax.beside`."""
