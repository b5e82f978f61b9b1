"""From form to form: a pass is a function on frozen data and knows no other pass; `bgdsl.pipeline` knows their order."""
