"""The wire: frozen messages, a bounded codec, every key and the journal's records. See README.md in this folder."""
