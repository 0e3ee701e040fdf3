"""Exports: tidy tables as CSV and Parquet, with a codebook that says what each column is."""
