"""Configurations that `--config` can name: one file per preset, each with a `get_config()`."""
