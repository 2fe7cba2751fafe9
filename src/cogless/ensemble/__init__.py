"""Many variants of one study: drawn, run anywhere, kept in a table, judged; and gains chosen over them."""
