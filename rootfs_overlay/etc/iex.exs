# The console of the board. An error here would lock people out, so that nothing is used before it is known to be there.

use_if_available(Toolshed)
import_if_available(Ganglion.Console)

if Code.ensure_loaded?(NervesMOTD), do: apply(NervesMOTD, :print, [])
