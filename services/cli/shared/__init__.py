"""What several commands share: options, waiting, tables, and how a command fails. It knows no command."""
