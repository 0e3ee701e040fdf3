"""Learning methods: one file a method, one common interface (`method.Method`)."""
