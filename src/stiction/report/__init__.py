"""Floor 6: figures and HTML pages, made from the files of `formats` alone."""
