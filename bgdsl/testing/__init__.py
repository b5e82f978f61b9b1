"""`test` blocks and how they are carried out; random and well-known models for tests of the compiler."""
