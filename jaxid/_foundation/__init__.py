"""Array types, status enumeration, input checks and linear algebra used by every folder."""
