"""The wire: frozen messages, a bounded codec, every key, journal records. README.md here is the contract."""
