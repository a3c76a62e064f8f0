"""Does an interval of 95 % hold the truth 95 times in a hundred?  Thousands of drives say."""
