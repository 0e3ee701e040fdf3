"""Figures for papers and READMEs, as PNG and SVG; matplotlib is loaded when one is drawn, not before."""
