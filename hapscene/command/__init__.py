"""The commands of `hapscene`, one module for each word or family of words; thin."""
