"""What texsss costs, beside what it is compared to in the same run. Prints; asserts nothing about time."""
