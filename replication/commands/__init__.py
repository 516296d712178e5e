"""The command line: parsers are light, and what a command does is imported when it runs."""
