"""The paper's claims, judged from results: quantities, intervals and rules."""
