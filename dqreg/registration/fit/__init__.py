"""Where a registration is: the loop that is run, how it ended, and how far poses lie apart."""
