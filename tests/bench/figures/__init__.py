"""Measures porttaped and porttape: sections of figures, a table of them, two builds compared."""
