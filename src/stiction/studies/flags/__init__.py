"""What identification says of a log after a wrong flag: known mistakes, made on purpose on records that it gets
right.
"""
