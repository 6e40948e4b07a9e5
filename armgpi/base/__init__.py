"""What all rooms use: arrays and their checks, files, text, and the declared parameters.

Takes nothing of the other rooms but the errors.
Gives checked arrays, one opener and one writer of files, text that is safe to print, and parameters.
"""
