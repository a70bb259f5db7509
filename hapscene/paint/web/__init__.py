"""The painter in the browser: its page, panels and tools, over viser, behind a server that lets in no other page."""
