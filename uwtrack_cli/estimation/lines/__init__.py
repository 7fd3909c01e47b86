"""How frequency lines are found, followed and grouped."""
