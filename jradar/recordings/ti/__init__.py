"""Files of TI's radars: DCA1000 samples and packets, and the descriptions of chirps."""
