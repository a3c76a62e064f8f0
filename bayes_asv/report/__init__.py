"""What an estimate says, for people and for programs: one document, several views."""
