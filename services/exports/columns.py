"""Columns that tables of sessions, studies and experiments share, explained once."""

from services.exports.table import Column, Kind

METHOD = Column("method", Kind.TEXT, "Learning method.")
EPISODE = Column("episode", Kind.WHOLE, "Number of the episode, from 0.")
MEASURE = Column("measure", Kind.TEXT, "What is measured; its unit is that of the column of `episodes`.")
CLAIM = Column("claim", Kind.TEXT, "The sentence.")
DIFFERENCE_LO = Column("lo", Kind.NUMBER, "Lower end of the difference's interval.")
DIFFERENCE_HI = Column("hi", Kind.NUMBER, "Upper end of the difference's interval.")
