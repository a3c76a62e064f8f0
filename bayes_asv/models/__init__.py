"""The readable half car: equations one can hold against a textbook, no speed intended."""
