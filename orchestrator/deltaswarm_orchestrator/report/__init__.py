"""The parts of a study's page: tables, figures, templates."""
