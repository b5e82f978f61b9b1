"""Programs as code: `numpy` writes a module, `native` machine code; `tape` and `interpret` stand before both."""
