"""Every reader of files against damaged and hostile bytes."""
