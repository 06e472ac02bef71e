"""Conformance tests of engines against exact solutions."""
