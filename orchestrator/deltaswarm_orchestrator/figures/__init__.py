"""The paper's figures and their kin: tables in, matplotlib figures out; only `style.save` writes files."""
