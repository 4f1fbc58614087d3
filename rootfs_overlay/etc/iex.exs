# The console of the board. An error here would lock people out, so that each module is used only if
# it is available, and errors are caught.

use_if_available(Toolshed)
import_if_available(Ganglion.Console)

try do
  if Code.ensure_loaded?(NervesMOTD), do: apply(NervesMOTD, :print, [])
catch
  kind, _reason -> IO.puts("no message of the day (#{kind})")
end
