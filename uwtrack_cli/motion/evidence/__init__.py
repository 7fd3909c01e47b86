"""Kinds of evidence: what each kind of data says of a hypothesis, a module each."""
