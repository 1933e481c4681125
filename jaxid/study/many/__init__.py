"""Many studies in processes of one host, continued from a folder."""
