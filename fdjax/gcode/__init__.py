"""G-code, followed line by line: one state machine to measure, check, stream, resume and play.

It loads no arrays: plain numbers only, so that a sender starts at once.
"""
