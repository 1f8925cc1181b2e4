"""Points that a radar itself found: bags, serial streams, tables, data sets."""
