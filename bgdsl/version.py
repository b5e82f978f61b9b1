"""The version of the tool, written into everything that it makes."""

VERSION = "0.1.0"
