"""What each type of component of SOFA means here: a table with one entry each."""
