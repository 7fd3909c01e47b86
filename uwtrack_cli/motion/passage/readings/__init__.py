"""What a contact may be beside a straight passage, and how likely each of it is."""
