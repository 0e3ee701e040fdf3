"""`sfid experiment`: one thin file for each experiment."""
