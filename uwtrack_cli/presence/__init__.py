"""What was heard: lines, rates, levels and passages -> segments of one kind each."""
