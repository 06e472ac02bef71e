"""The experiment on training with dry friction: its runs, their training and evaluation, and what follows from them."""
