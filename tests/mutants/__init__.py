"""Mutation test: put one small fault at a time into the code, see if a test notices
(docs/contributing.md)."""
