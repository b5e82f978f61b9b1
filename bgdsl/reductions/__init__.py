"""What may be left out of a model, and the model's source without it."""
