"""The paper's experiments, and the measures they are made of."""
