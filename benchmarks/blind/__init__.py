"""The diagnosis on cars, roads and faults of an author who has read only the pages for users."""
