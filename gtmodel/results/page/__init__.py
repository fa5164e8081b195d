"""report.html: the page of a study, one file for people.

page.py      the page: verdict, checks, pictures, sections, origin
drawing.py   pictures as SVG, small enough for a page, with the scales that its script reads values from
page.js      zoom and values of the pictures
page.css     look on screen and on paper
"""
