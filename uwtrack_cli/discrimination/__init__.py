"""Which of two contacts moves, and which is a stationary repeater."""
