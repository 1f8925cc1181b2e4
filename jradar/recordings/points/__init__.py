"""The points that a radar itself found: in bags, serial streams, tables and data sets."""
