"""Does generated C compute what Python computes?"""
