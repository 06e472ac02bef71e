"""Figures and HTML pages, made from the files of `formats` alone."""
