"""jaxid"""
