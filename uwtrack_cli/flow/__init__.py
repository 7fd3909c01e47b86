"""The catalogue of stages, recipes and the runs made of them."""
