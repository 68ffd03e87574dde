"""Tables and numbers of the Markdown documents, written from the data that reports/data keeps."""
