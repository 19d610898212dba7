/* What this extension was built by: told by `sjerk --version`, so that a report can be read. */
#pragma once

/* The compiler and the processor, as "gcc 12.2.0, x86_64": a text of the program's own. */
const char *sj_build(void);
