"""Does it read a table of numbers as people and loggers write it?

Text, Parquet or MDF; curves and logs alike. A table is read right or refused with row and cause;
what was decided is told.
"""
