from .server import BridgeServer as BridgeServer
