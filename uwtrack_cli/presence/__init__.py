"""What was heard: lines, rates, levels and passages -> stretches of one kind each."""
