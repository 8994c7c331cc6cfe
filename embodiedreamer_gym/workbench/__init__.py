"""The workbench: a page on this machine that shows a model beside recordings and tries effects on it."""
