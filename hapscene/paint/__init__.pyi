from .model.session import Session as Session
