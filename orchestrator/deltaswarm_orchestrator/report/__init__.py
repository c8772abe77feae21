"""What a study's page is made of: tables, figures, templates."""
