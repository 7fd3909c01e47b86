"""What flows through the chain: frozen containers of arrays, numpy only."""
