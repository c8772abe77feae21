"""What a sweep's runs say: statistics, reports and the judging of claims."""
