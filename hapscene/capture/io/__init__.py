"""Reading and writing of recordings: file formats, column maps, cleaning, HaTT import."""
