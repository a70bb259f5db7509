"""Web servers of the package's pages: `server.WebServer` serves one page, `listener.WebListener` WebSockets alone."""
