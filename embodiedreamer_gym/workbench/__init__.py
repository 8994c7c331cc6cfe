"""The workbench: a local web page that compares a model with recordings and lets the user try effects."""
