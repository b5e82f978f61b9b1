"""The forms that a model takes on its way to a run, data only; each says in `verify` what it promises."""
