"""Why a claim of the report does not hold on our aircraft, found out with the default seed."""

REASONS: dict[str, str] = {}
