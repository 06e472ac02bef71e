"""Policies in and out: others' networks as bundles, and bundles as others deploy them."""
