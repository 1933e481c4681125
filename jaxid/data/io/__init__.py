"""Reading and writing of files: records, inputs, tables on a grid, study files."""
